"""The operator page: HTTP and WebSocket around jobs and results. It decides who may, and computes nothing."""
