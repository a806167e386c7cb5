"""Published and own rules of measurement, each a frozen record with an id that never changes."""
