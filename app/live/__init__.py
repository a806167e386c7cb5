"""Speech while it is spoken, and the body that follows it: sessions that share one process. May
import `run`, `config`, `errors` and `text`; knows nothing of the page.
"""
