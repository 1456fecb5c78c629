"""Load fields: a pressure over the skin where no small number of contacts tells it."""
