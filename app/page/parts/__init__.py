"""What pieces of the page are made of; imports nothing else of the page."""
