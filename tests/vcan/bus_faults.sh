#!/bin/sh
# bus_faults.sh KERNEL PROGRAM [ARGUMENT]...: PROGRAM (bus_fault_test) in the guest, with a vcan that brings own frames
# back after its queue, as hardware does. For ./dev bench robot; ctest has small versions of its own.
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
kernel=$1
program=$2
shift 2
exec "$here/run_in_guest.sh" --kernel "$kernel" --timeout 10800 --program "$program" -- \
  'ip link del vcan0; ip link del vcan1; rmmod vcan; insmod /modules/vcan.ko echo=1' \
  'for i in vcan0 vcan1; do ip link add $i type vcan; ip link set $i up; done' \
  "$(basename "$program") $*"
