"""What a run looks like on the page: player, tables, figures, files; may import routes."""
