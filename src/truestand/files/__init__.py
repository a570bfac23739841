"""To and from disk: one file a format."""
