"""Ask a running flatcloth page for the garment and its grasps, and propose a pick.

FLATCLOTH_TOKEN=... python examples/robot_http.py http://127.0.0.1:8080 [ROTATION_DEG]
"""

import json
import os
import sys
import urllib.request


def ask(address: str, body: dict | None = None) -> dict:
    headers = {"Authorization": f"Bearer {os.environ['FLATCLOTH_TOKEN']}"}
    data = None if body is None else json.dumps(body).encode()  # with a body it is a POST
    with urllib.request.urlopen(urllib.request.Request(address, data, headers)) as answer:
        return json.load(answer)


if __name__ == "__main__":
    page, *rest = sys.argv[1:]
    at = f"?rotation={float(rest[0])}" if rest else ""  # where the item stands when the robot grasps
    shape = ask(f"{page}/robot/shape")
    print("shape", shape["revision"], "garment:", (shape["garment"] or {}).get("kind"))
    grasps = ask(f"{page}/robot/grasps{at}")
    for grasp in grasps["grasps"] + grasps["garment_points"]:
        print(grasp["name"], grasp["poses"] and grasp["poses"]["camera"]["position_m"])
    place = {"uv_m": grasps["grasps"][0]["flattened"]["uv_m"], "revision": shape["revision"]}
    proposed = ask(f"{page}/robot/pick{at}", {**place, "name": "again"})["grasp"]
    print("proposed:", proposed["id"], proposed["name"], proposed["poses"]["camera"]["quaternion_wxyz"])
