"""The benchmark of hidden effects: hearts whose truth is known, criticised blind, and the score."""
