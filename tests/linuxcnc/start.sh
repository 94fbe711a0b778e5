#!/bin/sh
# Runs LinuxCNC on its own loopback, its own /tmp (this folder), its own processes: all of it ends with this script.
set -e
ip link set lo up
mount --bind "$PWD" /tmp
cd /tmp
export RTAPI_UID=65534 RTAPI_FIFO_PATH=/tmp/rtapi.fifo HOME=/tmp
/usr/bin/python3 touch_bridge.py > touch_bridge.log 2>&1 &
exec linuxcnc robot.ini
