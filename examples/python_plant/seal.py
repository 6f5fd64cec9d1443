"""Signed LCM messages in Python: one end of a link. docs/reference/security.md explains the trailer and what it proves.

    seal = Seal(bytes.fromhex(open("robot.key").read()))
    bus.publish(channel, seal.sign(channel, measurement.encode()))
    message = seal.open(channel, data)   # None: forged, old, or a challenge that the next signature answers
"""
import hashlib
import hmac
import os
import time


class Seal:
    def __init__(self, key, window_s=2.0):
        self.key, self.window_s = key, window_s
        self.session, self.sent = os.urandom(8), 0
        self.peer, self.received, self.heard_s, self.answer = None, 0, 0.0, bytes(8)
        self.challenges = []  # the last two: number, and when it was drawn
        self.draw()

    def draw(self):
        self.challenges = [(os.urandom(8), time.monotonic())] + self.challenges[:1]

    def renew(self):
        if 0 < self.window_s / 2 <= time.monotonic() - self.challenges[0][1]:
            self.draw()

    def tag(self, channel, body):
        return hashlib.blake2s(channel.encode() + b"\0" + body, digest_size=16, key=self.key).digest()

    def sign(self, channel, message):
        self.renew()
        self.sent += 1
        body = message + self.session + self.sent.to_bytes(8, "big") + self.challenges[0][0] + self.answer
        return body + self.tag(channel, body)

    def open(self, channel, data):
        if len(data) < 48 or not hmac.compare_digest(self.tag(channel, data[:-16]), data[-16:]):
            return None
        self.renew()
        session, counter, challenge, answer = (data[i:i + 8] for i in range(len(data) - 48, len(data) - 16, 8))
        counter, now_s = int.from_bytes(counter, "big"), time.monotonic()
        if session == self.peer:
            if counter <= self.received:
                return None
            fresh = self.window_s <= 0 or any(answer == number and now_s - drawn_s <= self.window_s
                                              for number, drawn_s in self.challenges)
        else:
            fresh = answer == self.challenges[0][0]  # a new session must answer the present challenge
            if not fresh:
                if self.peer is None or 0 < self.window_s < now_s - self.heard_s:
                    self.answer = challenge
                return None
            self.peer = session
            self.draw()
        self.received, self.heard_s, self.answer = counter, now_s, challenge
        return data[:-48] or None if fresh else None
