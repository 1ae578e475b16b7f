"""The page of one subject for those who have to read it: measured, inferred, wrong, next."""
