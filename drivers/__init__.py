"""The bench: three devices behind three protocols, real or simulated in any mix."""
