"""What the page answers, one file a topic; each registers its routes with their policies."""
