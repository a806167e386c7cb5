"""One run from a request to a folder of files; of app it may import findings and errors."""
