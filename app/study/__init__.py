"""Many sessions analysed for a study: each by itself, then what they have in common."""
