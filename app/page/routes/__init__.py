"""What a browser may ask the server for beside Gradio: guard, media, live sound;
may import visitors.
"""
