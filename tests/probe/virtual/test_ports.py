"""Ports of the virtual cell."""

import socket

import pytest

from identify.model.files import InputError
from probe.virtual.ports import open_port


def test_a_socket_that_is_taken_is_refused_with_one_sentence():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]

        with pytest.raises(InputError, match=f"socket:{number}.*choose another"):
            open_port(f"socket:{number}")
