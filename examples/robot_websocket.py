"""Print what happens on a running flatcloth page: shapes, named points, and picks as they are made.

FLATCLOTH_TOKEN=... python examples/robot_websocket.py ws://127.0.0.1:8080 [COUNT]
"""

import json
import os
import sys

from websockets.sync.client import connect

page, *rest = sys.argv[1:]
headers = {"Authorization": f"Bearer {os.environ['FLATCLOTH_TOKEN']}"}
with connect(f"{page}/robot/events", additional_headers=headers) as events:
    for _ in range(int(rest[0]) if rest else 1_000_000):
        event = json.loads(events.recv())
        match event["type"]:
            case "hello":
                print("speaks", event["protocol"], "about", event["recording"])
            case "shape":
                print("shape", event["revision"], "of views", event["views"])
            case "points":
                print(event["kind"], [point["name"] for point in event["points"]])
            case "pick":
                poses = event["grasp"]["poses"] or {}
                print("pick", event["grasp"]["name"], poses.get("base") or poses.get("camera"))
            case "pick_deleted":
                print("deleted", event["id"])
