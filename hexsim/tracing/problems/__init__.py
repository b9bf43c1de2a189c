"""What a fit compares: residuals and their columns."""
