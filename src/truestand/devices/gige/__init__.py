"""A GigE Vision client: control, stream and the features of a camera."""
