"""Videos and pictures of a run; may import requests and callbacks."""
