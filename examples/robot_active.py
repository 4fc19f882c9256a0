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


def ask(address: str, data: bytes | None = None) -> dict:
    """Return the answer to GET, or with data to POST; {"error": why} if a view is not taken."""
    headers = {"Authorization": f"Bearer {os.environ['FLATCLOTH_TOKEN']}"}
    for _ in range(120):  # a server that is started again goes on where it was
        try:
            with urllib.request.urlopen(urllib.request.Request(address, data, headers)) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            if error.code != 409:
                raise SystemExit(error.read().decode()) from error
            return json.load(error)
        except OSError:
            time.sleep(0.5)
    raise SystemExit(f"{address} does not answer.")


def turn_to(angle_deg: float) -> None:
    """Turn your robot or turntable here, and wait until the item hangs still."""


def look() -> dict:
    """Return K, color and depth of your camera (docs/robots.md); nothing if flatcloth's camera looks."""
    return {}


def run(server: str) -> dict:
    state = ask(f"{server}/robot/next")
    while not state["done"]:
        if state["waiting"]:  # on the page, an operator decides about a view
            time.sleep(0.5)
        else:
            print(f"to {state['angle_deg']:g} degrees: {state['why']}")
            turn_to(state["angle_deg"])
            view = {"angle_deg": state["angle_deg"], "number": state["number"], **look()}
            state = ask(f"{server}/robot/view", json.dumps(view).encode())
            print(" ", state.get("taken") or state["error"])
        if not state.get("done"):
            state = ask(f"{server}/robot/next")
    print(state["reason"])
    for point in state["points"]:
        print(point["name"], point["poses"] and point["poses"]["camera"]["position_m"])
    return state


if __name__ == "__main__":
    run(sys.argv[1])
