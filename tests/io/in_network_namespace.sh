#!/bin/sh
# Runs a program where it sees a loopback of its own and nothing else: multicast tests neither reach the network nor
# meet another test. With --no-route first, that loopback takes no multicast. Fails, and says so, where the machine
# forbids network namespaces.
set -eu
route='ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo'
if [ "${1:-}" = --no-route ]; then
  route='ip link set lo up'
  shift
fi
# an ordinary user may make a namespace in which it still may do nothing (Ubuntu 24.04), so the whole is tried
for isolated in "unshare -n" "unshare -rn"; do
  # shellcheck disable=SC2086 # two words
  if $isolated sh -c "$route" 2>/dev/null; then
    exec $isolated sh -c "$route"' && exec "$@"' sh "$@"
  fi
done
# passwordless sudo makes the namespace; the program still runs as this user
if sudo -n true 2>/dev/null; then
  exec sudo -n unshare -n sh -c "$route"' && exec "$@"' sh \
    setpriv --reuid "$(id -u)" --regid "$(id -g)" --clear-groups "$@"
fi
cat >&2 <<'END'
cannot make a network namespace. Run as root, or allow namespaces to users:
  sudo sysctl kernel.unprivileged_userns_clone=1                    (Debian)
  sudo sysctl kernel.apparmor_restrict_unprivileged_userns=0        (Ubuntu 24.04)
END
exit 1
