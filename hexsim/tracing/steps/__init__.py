"""The steps of a trace, one file a row of docs/tracing.md."""
