"""Example of a ROS 2 node that shows the present of a delayed camera. UNTESTED: linted only.

It subscribes to image_raw (rgb8 or bgr8), camera_info and cmd_vel, and publishes predicted.
Parameter camera_height_m: height of the camera above the road.
"""

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from geovp_classic.errors import Incompatible
from geovp_classic.streaming import Command, LivePredictor
from geovp_classic.types import Intrinsics


def seconds(stamp: Time) -> float:
    """Return a stamp in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


class PredictiveDisplay(Node):
    """Views of the present, twenty times a second."""

    def __init__(self) -> None:
        super().__init__("predictive_display")
        self.declare_parameter("camera_height_m", 1.5)
        self.live: LivePredictor | None = None
        self.commands: list[Command] = []
        self.publisher = self.create_publisher(Image, "predicted", 1)
        pushing = MutuallyExclusiveCallbackGroup()
        showing = MutuallyExclusiveCallbackGroup()
        self.create_subscription(CameraInfo, "camera_info", self.on_camera, 1)
        self.create_subscription(Image, "image_raw", self.on_image, 1, callback_group=pushing)
        self.create_subscription(Twist, "cmd_vel", self.on_command, 10, callback_group=showing)
        self.create_timer(0.05, self.show, callback_group=showing)

    def on_camera(self, info: CameraInfo) -> None:
        """Start when the camera is known."""
        if self.live is None:
            camera = Intrinsics(info.k[0], info.k[4], info.k[2], info.k[5], info.width, info.height)
            height_m = self.get_parameter("camera_height_m").value
            self.live = LivePredictor(camera, height_m)

    def on_image(self, message: Image) -> None:
        """Push a frame."""
        if self.live is None:
            return
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        frame = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
        if message.encoding == "bgr8":
            frame = frame[..., ::-1]
        self.live.push(frame, seconds(message.header.stamp))

    def on_command(self, twist: Twist) -> None:
        """Remember the operator's last commands."""
        now_s = seconds(self.get_clock().now().to_msg())
        # ROS turns counterclockwise, to the left.
        command = Command(now_s, twist.linear.x, -twist.angular.z)
        self.commands = [*self.commands, command][-100:]

    def show(self) -> None:
        """Publish the view of the present."""
        if self.live is None:
            return
        now = self.get_clock().now().to_msg()
        try:
            view = self.live.view(seconds(now), self.commands)
        except Incompatible:
            return
        if view.warning is not None:
            self.get_logger().warning(view.warning, throttle_duration_sec=1.0)
        height, width, _ = view.frame.shape
        message = Image(height=height, width=width, encoding="rgb8", step=3 * width)
        message.header.stamp = now
        message.data = view.frame.tobytes()
        self.publisher.publish(message)


def main() -> None:
    """Run the node."""
    rclpy.init()
    executor = MultiThreadedExecutor()
    executor.add_node(PredictiveDisplay())
    executor.spin()


if __name__ == "__main__":
    main()
