"""Routes of the server in addition to Gradio's: guard, media, live sound; may import visitors."""
