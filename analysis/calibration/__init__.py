"""From what the instruments read to what they measured."""
