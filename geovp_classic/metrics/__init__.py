"""One number per future step from a prediction and what really came."""
