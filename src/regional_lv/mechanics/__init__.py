"""The simulator: a left ventricle of any registered law, inflated to its end-diastolic pressure."""
