"""What a run leaves behind: log files, Rerun recording, figures, report."""
