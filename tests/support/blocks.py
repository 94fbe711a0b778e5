"""Lines of a program as a tree of blocks, and expressions in its language as Python evaluates them."""

import re


def tree(lines, kinds):
    """Nested lists: a line, or (head, body, else_body); `kinds` are (opening, middle, closing) patterns."""
    root: list = []
    stack = [(None, None, root, None)]
    for line in lines:
        kind, head, body, other = stack[-1]
        opened = next((k for k in kinds if re.fullmatch(k[0], line)), None)
        if opened:
            stack.append((opened, line, [], None))
        elif kind and kind[1] and re.fullmatch(kind[1], line):
            stack[-1] = (kind, head, body, [])
        elif kind and re.fullmatch(kind[2], line):
            stack.pop()
            _here(stack).append((head, body, other or []))
        else:
            (body if other is None else other).append(line)
    assert len(stack) == 1, f"{stack[-1][1]} is not closed"
    return root


def _here(stack):
    _, _, body, other = stack[-1]
    return body if other is None else other
