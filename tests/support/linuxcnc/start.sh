#!/bin/sh
# Runs LinuxCNC on its own loopback, its own /tmp (this folder), its own processes: all of it ends with this script.
set -e
/usr/bin/python3 -c 'import fcntl, socket, struct; fcntl.ioctl(socket.socket(), 0x8914, struct.pack("16sh", b"lo", 0x49))'
mount --bind "$PWD" /tmp
cd /tmp
export RTAPI_UID=65534 RTAPI_FIFO_PATH=/tmp/rtapi.fifo HOME=/tmp
/usr/bin/python3 touch_bridge.py > touch_bridge.log 2>&1 &
linuxcnc robot.ini
while [ -e restart ]; do
    rm restart
    linuxcnc robot.ini
done
