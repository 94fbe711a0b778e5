"""A line to GRBL against a stand-in: answers up to the echo, alarms, silence."""

import re

import pytest
from touching import Ticks

from probe.controllers.grbl_link import GrblLink
from probe.line.controller import LinkLost, Refused

IDLE = "<Idle|MPos:0.000,0.000|FS:0,0>"


class Device:
    """A GRBL of two axes that answers each line with what was ordered, and echoes messages."""

    url = "device"

    def __init__(self, clock, echo=True, **answers):
        self.clock, self.echo, self.answers, self.sent, self.out = clock, echo, answers, b"", []

    def write(self, data):
        self.sent += data
        if data == b"?":
            self.out.append(IDLE)
            return
        for line in data.decode().splitlines():
            tag = re.fullmatch(r"\(MSG,(\w+)\)", line)
            if tag and self.echo:
                self.out += [f"[MSG:{tag[1]}]", "ok"]
            elif line in self.answers:
                self.out += self.answers[line]

    def read(self, timeout):
        self.clock.sleep(timeout)
        lines, self.out = self.out, []
        return "".join(f"{line}\r\n" for line in lines).encode()


def link(**options):
    clock = Ticks()
    device = Device(clock, **options)
    return GrblLink(device, clock, 2), device


def test_what_is_said_up_to_the_echo_is_the_answer_and_noise_is_not():
    there, _ = link(**{"$I": ["[VER:1.1h]", "no\x07ise", "ok"]})

    assert there.told("$I") == ["[VER:1.1h]", "ok"]


def test_an_alarm_without_an_echo_is_a_refusal():
    there, _ = link(echo=False, **{"G1X1": ["ALARM:2", "ok"]})

    with pytest.raises(Refused) as refused:
        there.told("G1X1")

    assert refused.value.code == "LIMIT"
    assert "ALARM:2" in str(refused.value)


def test_a_line_that_says_nothing_at_all_is_lost():
    there, device = link()
    device.write = lambda data: None
    began = there.clock.now()

    with pytest.raises(LinkLost):
        there.told("$I")

    assert there.clock.now() - began < 10.0
