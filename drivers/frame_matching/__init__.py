"""Which trigger each image of a camera belongs to, by counts, identifiers and timestamps."""
