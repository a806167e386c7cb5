"""Identity of visitors, their files, uploads and queue; may import parts."""
