"""Any heart from its segment table: the emulator that ships, and answers from it."""
