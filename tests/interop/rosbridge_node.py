"""A web page's way to a robot: roslibpy behind a rosbridge server, which is a node on rmw_fastrtps.

`rosbridge_node.py PROGRAM PORT`: starts the server, whose environment the caller sets, and connects
to it. It hears `/odom` and `/estopped`, prints JSON lines, and ends with its standard input:

    {"do":"drive","vx":0.1,"hz":20}             geometry_msgs/Twist on /cmd_vel
    {"do":"rest"}
    {"do":"press","data":true}                  a std_msgs/Bool on /yahboomd/estop
"""

import json
import os
import subprocess
import sys
import threading

import roslibpy

STOP = "/yahboomd/estop"


def say(**line):
    # One write: messages are heard on a thread of their own.
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


class Page:
    def __init__(self, port):
        self.ros = roslibpy.Ros("127.0.0.1", port)
        self.ros.run(timeout=60)
        self.resting = threading.Event()
        self.driver = None
        for topic, ros_type in (
            ("/odom", "nav_msgs/msg/Odometry"),
            ("/estopped", "std_msgs/msg/Bool"),
        ):
            self.topic(topic, ros_type).subscribe(self.hearing(topic))
        self.speed = self.topic("/cmd_vel", "geometry_msgs/msg/Twist")
        self.button = self.topic(STOP, "std_msgs/msg/Bool")
        for each in (self.speed, self.button):
            each.advertise()

    def topic(self, name, ros_type):
        return roslibpy.Topic(self.ros, name, ros_type)

    @staticmethod
    def hearing(topic):
        return lambda message: say(event="message", topic=topic, message=message)

    def press(self, data):
        self.button.publish({"data": data})

    def drive(self, vx, hz):
        self.resting.clear()
        self.driver = threading.Thread(target=self.driving, args=(vx, 1.0 / hz), daemon=True)
        self.driver.start()

    def driving(self, vx, period_s):
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        while not self.resting.wait(period_s):
            self.speed.publish({"linear": {**zero, "x": vx}, "angular": zero})

    def rest(self):
        self.resting.set()
        self.driver.join()


def main():
    program, port = sys.argv[1:]
    # No wheel brings the messages of its rosapi.
    command = [program, "--bind", f"127.0.0.1:{port}", "--no-rosapi"]
    server = subprocess.Popen(command, stdout=sys.stderr, stdin=subprocess.DEVNULL)
    try:
        page = Page(int(port))
        say(event="ready")
        for line in sys.stdin:
            order = json.loads(line)
            getattr(page, order.pop("do"))(**order)
    finally:
        server.terminate()
        server.wait(10)
        os._exit(0)  # its reactor cannot be started twice, and waits for nothing


if __name__ == "__main__":
    main()
