"""Tracks of a bouncing ball, simulated with known impacts: the truths of benchmarks/tracks.py.

It uses nothing of the library. A ball falls, bounces and drifts in a vacuum; a camera that is rolled
takes it with an exposure that blurs, and a tracker reads its centre with noise and mistakes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

GRAVITY = 9.81
RATES = (30, 50, 60, 100, 120, 240, 500, 1000)
KINDS = ("opencv", "trackpy", "tracker", "heights")
"""How a track is saved: frames and pixels downwards (two), seconds and metres, heights alone."""

SHORTEST = 0.02
"""In s: with shorter flights the ball lies still."""

_PARTS = 8


class Truth(NamedTuple):
    """What was simulated: `text` of the file and its `kind`; the times of `impact` (m,) in s, in
    the middle of each contact, and the `flight` (m + 1,) in s before and after each; e and the
    scatter of ln e; `seen` (m + 1,), how many frames of each flight the file has;
    `scale` of a unit of the file in m; `tilt` in degrees, NaN without x.
    """

    text: str
    kind: str
    rate: int
    impact: np.ndarray
    flight: np.ndarray
    seen: np.ndarray
    height: np.ndarray
    e: float
    scatter: float
    noise: float
    outliers: float
    scale: float
    tilt: float


def draw(random: np.random.Generator, *, kind: str | None = None, bounces: bool = True) -> Truth:
    """One track; without bounces the ball is thrown up and caught."""
    kind = kind or str(random.choice(KINDS))
    rate = int(random.choice(RATES))
    e = random.uniform(0.5, 0.95)
    scatter = 0.0 if random.random() < 0.5 else 10 ** random.uniform(-3, -2)
    height = random.uniform(0.3, 1.5)
    speed = [np.sqrt(2 * GRAVITY * height)]
    most = int(random.integers(1, 9)) if bounces else 0
    while len(speed) <= most and 2 * speed[-1] * e / GRAVITY > SHORTEST:
        speed.append(speed[-1] * e * np.exp(scatter * random.normal()))
    speed = np.array(speed)
    count = speed.size - 1
    flight = 2 * speed / GRAVITY
    power = random.uniform(0, 0.2)  # of a shell, and by Hertz
    contact = 10 ** random.uniform(-3.3, -2.1) * (speed[:-1] / speed[0]) ** -power
    held = random.uniform(0.1, 0.5) if random.random() < 0.6 else 0.0
    release = held + random.uniform(0.0, 0.1)
    start = np.zeros(count + 1)  # of each flight; the first is virtual
    start[0] = release - flight[0] / 2
    for k in range(count):
        start[k + 1] = start[k] + flight[k] + contact[k]
    # Where it is caught in the last flight, and held for a while; or the camera stops before.
    caught = start[-1] + flight[-1] * random.uniform(0.35, 0.9)
    end = caught + (random.uniform(0.1, 0.4) if random.random() < 0.5 else 0.0)
    begin = 0.0 if held or random.random() < 0.5 else release + 0.5 * random.random() * flight[0] / 2
    drift = random.uniform(-0.4, 0.4) * np.cumprod(np.r_[1, random.uniform(0.6, 1.05, count)])
    edge = np.r_[release, start[1:], caught]
    along = np.r_[0, np.cumsum(drift * np.diff(edge))]

    def height_at(t: np.ndarray) -> np.ndarray:
        t = np.minimum(t, caught)
        k = np.clip(np.searchsorted(start[1:], t, "right"), 0, count)
        since = t - start[k]
        y = GRAVITY / 2 * since * (flight[k] - since)
        if count:
            # In contact before flight k + 1: half a sine below the floor.
            one = np.minimum(k, count - 1)
            part = np.clip((since - flight[k]) / contact[one], 0, 1)
            dip = -speed[one] * contact[one] / np.pi * np.sin(np.pi * part)
            y = np.where((since > flight[k]) & (k < count), dip, y)
        return np.where(t < release, height, y)

    n = int((end - begin) * rate)
    frame = np.arange(n)
    time = begin + (frame + random.random()) / rate
    blur = random.uniform(0.05, 0.9) / rate * (np.arange(_PARTS) - (_PARTS - 1) / 2) / _PARTS
    many = time[:, None] + blur
    y = height_at(many).mean(axis=1)
    x = np.interp(many, edge, along).mean(axis=1)
    pixels = random.uniform(150, 1200) / height  # per metre
    tilt = np.radians(random.uniform(-10, 10)) if kind != "heights" else 0.0
    u, v = x * np.cos(tilt) - y * np.sin(tilt), x * np.sin(tilt) + y * np.cos(tilt)
    noise = 10 ** random.uniform(np.log10(0.3), np.log10(3.0))
    place = pixels * np.stack([u, v], axis=1) + noise * random.normal(size=(n, 2))
    share = random.uniform(0, 0.05) if random.random() < 0.6 else 0.0
    off = random.random(n) < share
    low, high = place.min(axis=0) - 50, place.max(axis=0) + 50
    place[off] = random.uniform(low, high, size=(int(off.sum()), 2))
    there = random.random(n) >= random.uniform(0, 0.1) * (random.random() < 0.5)
    text, scale = _file(random, kind, frame, rate, place, there, pixels)
    k = np.searchsorted(start[1:], time, "right")
    inside = (time > start[k] + 0.5 / rate) & (time < (start + flight)[k] - 0.5 / rate)
    inside &= (time > release) & (time < caught) & there & ~off
    return Truth(
        text,
        kind,
        rate,
        (start[1:] - contact / 2) - time[0] if n else np.zeros(0),
        flight,
        np.bincount(k[inside], minlength=count + 1),
        pixels * GRAVITY * flight**2 / 8 / noise,
        e,
        scatter,
        noise,
        share,
        scale,
        np.degrees(tilt) if kind != "heights" else np.nan,
    )


def _file(
    random: np.random.Generator,
    kind: str,
    frame: np.ndarray,
    rate: int,
    place: np.ndarray,
    there: np.ndarray,
    pixels: float,
) -> tuple[str, float]:
    """The text of a file, and what a unit of its lengths is in m."""
    down = place * [1, -1] + [400, 1000]
    if kind == "opencv":
        # A frame without the ball has empty cells.
        lines = [
            f"{k},{a:.2f},{b:.2f}" if ok else f"{k},,"
            for k, (a, b), ok in zip(frame, down, there, strict=True)
        ]
        return "\n".join(["frame,x,y", *lines]) + "\n", 1 / pixels
    if kind == "trackpy":
        head = ",y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle"
        lines = [
            f"{k},{b:.3f},{a:.3f},900.1,2.1,0.1,30.0,1200.0,0.1,{k},0"
            for k, (a, b), ok in zip(frame, down, there, strict=True)
            if ok
        ]
        return "\n".join([head, *lines]) + "\n", 1 / pixels
    wrong = 1 + random.uniform(-0.03, 0.03)  # how well the stick of Tracker was laid
    up = place / pixels * wrong
    if kind == "tracker":
        lines = [
            f"{k / rate:.6E}\t{a:.6E}\t{b:.6E}"
            for k, (a, b), ok in zip(frame, up, there, strict=True)
            if ok
        ]
        return "\n".join(["mass_A", "t\tx\ty", *lines]) + "\n", 1 / wrong
    lines = [
        f"{k / rate:.6f};{b:.5f}" for k, (_, b), ok in zip(frame, up, there, strict=True) if ok
    ]
    return "\n".join(["time (s);height (m)", *lines]) + "\n", 1 / wrong
