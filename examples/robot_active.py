"""Turn an item to where flatcloth asks until it knows enough, then print the poses of the wanted points.

flatcloth active --cell --listen 8090 --out found --goal points:shoulder_left,shoulder_right
FLATCLOTH_TOKEN=... python examples/robot_active.py http://127.0.0.1:8090
"""

import json
import os
import sys
import time
import urllib.error
import urllib.request

PATIENCE_S = 60.0  # a server that was restarted goes on where it was


class RefusedError(Exception):
    """flatcloth does not take a view; the text is its reason."""


def ask(address: str, body: dict | None = None) -> dict:
    headers = {"Authorization": f"Bearer {os.environ['FLATCLOTH_TOKEN']}"}
    data = None if body is None else json.dumps(body).encode()  # with a body it is a POST
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            with urllib.request.urlopen(urllib.request.Request(address, data, headers)) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            raise RefusedError(error.read().decode()) from error
        except OSError:  # it is being restarted
            if time.monotonic() > until:
                raise
            time.sleep(0.5)


def turn_to(angle_deg: float) -> None:
    """Turn your robot or turntable here, and wait until the item hangs still."""


def look() -> dict:
    """Return K, color and depth of your camera (docs/robots.md); nothing if flatcloth's camera looks."""
    return {}


def run(server: str) -> dict:
    following = ask(f"{server}/robot/next")
    while not following["done"]:
        if following["waiting"]:  # on the page, an operator decides about a view
            time.sleep(0.5)
            following = ask(f"{server}/robot/next")
            continue
        print(f"to {following['angle_deg']:g} degrees: {following['why']}")
        turn_to(following["angle_deg"])
        answered = {"angle_deg": following["angle_deg"], "number": following["number"]}
        try:
            following = ask(f"{server}/robot/view", {**answered, **look()})
            print("  got", following["taken"]["got"], *following["taken"]["told"], sep="\n  ")
        except RefusedError as error:  # such as a view that was taken before the server was killed
            print("  refused:", error)
            following = ask(f"{server}/robot/next")
    print(following["reason"])
    for point in following["points"]:
        print(point["name"], point["poses"] and point["poses"]["camera"]["position_m"])
    return following


if __name__ == "__main__":
    run(sys.argv[1])
