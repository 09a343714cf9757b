"""Files as they are found: measurements of spreadsheets and instruments, made into campaigns."""
