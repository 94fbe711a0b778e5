"""A controller of TOUCH/1 written from the page `probe/line/TOUCH1.md` alone, as a PLC would have it: cycle by cycle.

It imports nothing of touchcal and shares no code with the other controllers of the tests. The world before it is asked
for one thing, whether the touch input is closed where the robot stands.
"""

from binascii import crc_hqx
from collections.abc import Callable

CYCLE = 0.001  # [s]
BRAKE = 20  # cycles from a contact in a search to where the robot stands

Joints = tuple[float, ...]


def sealed(text: str) -> bytes:
    return f"{text}*{crc_hqx(text.encode(), 0xFFFF):04X}\n".encode()


class PaperController:
    """`cycle` is called every millisecond, `hear` with what comes; `said` is what goes out."""

    def __init__(self, q: Joints, closed: Callable[[Joints], bool], boot: int = 0xA000) -> None:
        self.q, self.closed, self.boot, self.said, self.text = q, closed, boot, b"", b""
        self.start_up()

    def start_up(self) -> None:
        self.boot += 1
        self.last, self.answer, self.latched, self.quiet = 0, "", "", 0
        self.path: list[Joints] = []  # the places of the cycles to come
        self.verb, self.code, self.guarded = "", "", False
        self.began, self.back = self.q, ()  # of the last motion; after EARLY, where the way back ends

    # --- lines ----------------------------------------------------------------------------------------------------

    def hear(self, data: bytes) -> None:
        *lines, self.text = (self.text + data).split(b"\n")
        self.text = self.text[-300:]
        for raw in lines:
            line = raw.decode("latin-1").removesuffix("\r")
            words = line.split(" ")
            if words[0] == "!" and len(words) == 3 and words[1] in ("HB", "STOP") and words[2].isdecimal():
                self.quiet = 0
                self.urgent(words[1], int(words[2]))
                continue
            body = line.rpartition("*")[0]
            words = body.split(" ")
            if len(line) > 199 or sealed(body) != raw.removesuffix(b"\r") + b"\n" or not words[0].isdecimal():
                self.said += sealed("? NAK")
                continue
            self.quiet = 0
            self.said += sealed(f"{int(words[0])} {self.reply(int(words[0]), words[1:])}")

    def urgent(self, word: str, beat: int) -> None:
        if word == "STOP" and self.verb:
            self.halt("STOPPED")
        state = "RUN" if self.verb else "IDLE"
        probe = int(self.closed(self.q))
        self.said += sealed(f"! ST boot={self.boot:X} {state} seq={self.last} hb={beat} probe={probe} q={text(self.q)}")

    def reply(self, number: int, words: list[str]) -> str:
        if words[:1] == ["HELLO"] and number == 0 and len(words) == 2:
            return f"OK TOUCH/1 boot={self.boot:X} joints={len(self.q)} last={self.last} nonce={words[1]}"
        if number == self.last and number:
            return "ACK" if self.verb else self.answer
        if self.verb:
            return "ERR BUSY"
        if number != self.last % 65535 + 1:
            return "ERR OLDSEQ"
        self.last, self.answer = number, ""
        self.answer = self.latch() if words == ["LATCH"] else self.motion(words)
        return self.answer

    def latch(self) -> str:
        return f"OK boot={self.boot:X} {self.latched}" if self.latched else "ERR NOLATCH"

    def motion(self, words: list[str]) -> str:
        try:
            verb, target, speed, boot = words
            end, rate = tuple(float(word) for word in target.split(",")), float(speed)
        except ValueError:
            return "ERR SYNTAX"
        if verb not in ("MOVE", "SEARCH") or len(end) != len(self.q) or rate <= 0:
            return "ERR SYNTAX"
        if boot != f"boot={self.boot:X}":
            return "ERR BOOT"
        if verb == "SEARCH" and self.closed(self.q):
            return "ERR ALREADY"
        if self.back and (verb == "SEARCH" or not between(end, self.q, self.back)):
            return "ERR EARLY"
        way = [b - a for a, b in zip(self.q, end, strict=True)]
        count = max(1, round(max(abs(w) for w in way) / rate / CYCLE))
        self.path = [tuple(a + w * i / count for a, w in zip(self.q, way, strict=True)) for i in range(1, count)] + [
            end
        ]
        self.guarded = verb == "SEARCH" or not (self.closed(self.q) or self.back)
        self.verb, self.code, self.began, self.back = verb, "", self.q, ()
        return "ACK"

    # --- cycles ---------------------------------------------------------------------------------------------------

    def cycle(self) -> None:
        self.quiet += 1
        if not self.verb:
            pass
        elif self.quiet * CYCLE > 0.75:
            self.halt("DEADMAN")
        else:
            self.step()

    def step(self) -> None:
        if self.path:
            self.q = self.path.pop(0)
        contact = self.guarded and self.closed(self.q)
        if contact and self.verb == "MOVE":
            self.back = self.began
            self.halt("EARLY")
            return
        if contact:
            self.guarded = False
            self.latched, self.code = f"seq={self.last} q={text(self.q)}", "CONTACT"
            self.path = self.path[:BRAKE]
        if not self.path:
            self.finish()

    def finish(self) -> None:
        if self.code:
            self.end(f"CONTACT boot={self.boot:X} {self.latched} stop={text(self.q)}")
        else:
            self.end(f"{'OK' if self.verb == 'MOVE' else 'NOCONTACT'} q={text(self.q)}")

    def halt(self, code: str) -> None:
        self.path = []
        self.end(f"ERR {code}")

    def end(self, answer: str) -> None:
        self.verb, self.answer = "", answer
        self.said += sealed(f"{self.last} {answer}")


def text(q: Joints) -> str:
    return ",".join(f"{value:.6f}" for value in q)


def between(q: Joints, a: Joints, b: Joints) -> bool:
    """Whether a place lies on the straight way from a to b."""
    way = [y - x for x, y in zip(a, b, strict=True)]
    longest = max(range(len(way)), key=lambda i: abs(way[i]))
    if not way[longest]:
        return False
    share = (q[longest] - a[longest]) / way[longest]
    return -1e-6 < share < 1 + 1e-6 and all(abs(x + share * w - y) < 1e-3 for x, w, y in zip(a, way, q, strict=True))
