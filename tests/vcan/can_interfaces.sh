#!/bin/sh
# Makes the interfaces that the tests expect: vcan0 and vcan1, and the pair vx0 <-> vx1, whose ends have a real
# queue. Run by root of a network namespace or of a guest.
set -eu
for name in vcan0 vcan1; do
  ip link add "$name" type vcan
  ip link set "$name" up
done
ip link add vx0 type vxcan peer name vx1
ip link set vx0 up
ip link set vx1 up
