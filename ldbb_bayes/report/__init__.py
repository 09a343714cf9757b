"""What one shows: numbers, figures, pages."""
