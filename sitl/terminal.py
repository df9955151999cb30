"""Text for the user's terminal."""


def printable(text: str) -> str:
    """The text with blanks for control characters, which steer a terminal."""
    return "".join(char if char.isprintable() else " " for char in text)
