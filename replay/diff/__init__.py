"""Names the first message in which two logs part."""
