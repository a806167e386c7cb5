"""Results of a run on the page: player, tables, figures and files; may import routes."""
