"""The reader of a transcript of a line."""


def read_transcript(text: str) -> list[tuple[str, bytes]]:
    r"""What a Recorder wrote: direction and bytes of every line.

    >>> read_transcript("     0.001 > 0 HELLO 5f*ABCD\\n")
    [('>', b'0 HELLO 5f*ABCD\n')]
    """
    entries = (line.lstrip().split(" ", 2) for line in text.splitlines() if line.strip())
    return [(way, words.encode("ascii").decode("unicode_escape").encode("latin-1")) for _, way, words in entries]
