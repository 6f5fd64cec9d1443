#!/bin/sh
# Runs a program where it sees a loopback of its own and nothing else: multicast tests neither reach the
# network nor meet another test. Fails, and says so, where the machine forbids network namespaces.
set -eu
if ! unshare -rn true 2>/dev/null; then
  echo "cannot make a network namespace (unshare -rn):" \
    "allow unprivileged user namespaces or run as root" >&2
  exit 1
fi
exec unshare -rn sh -eu -c '
  ip link set lo up multicast on
  ip route add 224.0.0.0/4 dev lo
  exec "$@"' sh "$@"
