"""The door: ``python app.py`` starts the page."""

from app.page.launch import main

if __name__ == "__main__":
    main()
