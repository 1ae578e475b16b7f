"""The study's tables: CSV for programs, LaTeX (booktabs) for papers."""
