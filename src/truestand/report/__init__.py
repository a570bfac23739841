"""A record -> HTML and terminal tables. It prints; it never computes."""
