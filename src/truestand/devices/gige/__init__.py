"""Our GigE Vision client: control, stream and the camera's own list of features."""
