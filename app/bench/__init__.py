"""What each stage costs, beside a naive way, and what a visitor of the page waits for; may import
all of app but page and commands.
"""
