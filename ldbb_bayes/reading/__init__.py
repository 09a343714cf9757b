"""Import of foreign files, such as spreadsheets and exports of instruments, as campaigns."""
