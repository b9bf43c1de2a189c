"""What a trace leaves: JSON, page, figures, recording."""
