"""Ask a running flatcloth page for the garment and its grasps, then print picks as the operator makes them.

python examples/robot_client.py http://127.0.0.1:8080 TOKEN [COUNT]
"""

import asyncio
import json
import sys
import urllib.request

import websockets


def ask(page: str, path: str, token: str) -> dict:
    request = urllib.request.Request(page + path, headers={"Authorization": f"Bearer {token}"})
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


async def follow(page: str, token: str, count: int) -> None:
    address = page.replace("http", "ws", 1) + "/robot/picks"
    headers = {"Authorization": f"Bearer {token}"}
    async with websockets.connect(address, origin=page, additional_headers=headers) as picks:
        for _ in range(count):
            grasp = json.loads(await picks.recv())["grasp"]
            print(grasp["name"], (grasp["poses"] or {}).get("base") or grasp["poses"])


if __name__ == "__main__":
    page, token, *rest = sys.argv[1:]
    print("garment:", (ask(page, "/robot/shape", token)["garment"] or {}).get("kind"))
    for grasp in ask(page, "/robot/grasps", token)["garment_points"]:
        print(grasp["name"], grasp["position_m"])
    asyncio.run(follow(page, token, int(rest[0]) if rest else 1_000_000))
