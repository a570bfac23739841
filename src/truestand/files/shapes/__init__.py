"""Points, meshes, clouds."""
