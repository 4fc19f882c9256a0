"""Read picks, frames and the cloud of a running flatcloth page as ROS messages, and propose a pick.

FLATCLOTH_TOKEN=... python examples/robot_rosbridge.py ws://127.0.0.1:8080   (pip install roslibpy)
"""

import os
import queue
import sys

import roslibpy

TOPICS = {
    "/flatcloth/picks": "geometry_msgs/PoseArray",
    "/tf": "tf2_msgs/TFMessage",
    "/flatcloth/cloud": "sensor_msgs/PointCloud2",
}
headers = {"Authorization": f"Bearer {os.environ['FLATCLOTH_TOKEN']}"}
ros = roslibpy.Ros(f"{sys.argv[1]}/robot/rosbridge", headers=headers)
ros.run()
heard = {name: queue.Queue() for name in TOPICS}
for name, kind in TOPICS.items():
    roslibpy.Topic(ros, name, kind).subscribe(heard[name].put)
poses = heard["/flatcloth/picks"].get(timeout=30)["poses"]
print("picks:", [pose["position"] for pose in poses])
print("frames:", [each["child_frame_id"] for each in heard["/tf"].get(timeout=30)["transforms"]])
print("points:", heard["/flatcloth/cloud"].get(timeout=30)["width"])
propose = roslibpy.Service(ros, "/flatcloth/propose_pick", "flatcloth/ProposePick")
wanted = {"position_m": list(poses[0]["position"].values()), "name": "by ROS"}
print("proposed:", propose.call(roslibpy.ServiceRequest(wanted), timeout=30)["grasp"]["id"])
ros.terminate()
