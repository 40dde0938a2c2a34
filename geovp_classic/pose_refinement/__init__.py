"""Better poses from the images: refinements that stand between a pose source and a renderer."""
