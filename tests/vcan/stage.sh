# Sourced by run_on_can.sh and run_in_guest.sh: what to run, put into one folder.

stage_die() { printf 'virtual CAN: %s\n' "$*" >&2; exit 1; }

# Sets kernel, limit_s, memory_MB, programs and files (one a line) and commands (one a line).
parse_arguments() {
  kernel=
  limit_s=240
  memory_MB=512
  programs=
  files=
  newline='
'
  while [ $# -gt 0 ] && [ "$1" != -- ]; do
    [ $# -ge 2 ] || stage_die "$1 needs a value"
    case $1 in
      --kernel) kernel=$2 ;;
      --timeout) limit_s=$2 ;;
      --memory) memory_MB=$2 ;;
      --program) programs=$programs$2$newline ;;
      --file) files=$files$2$newline ;;
      *) stage_die "unknown argument '$1' (known: --kernel --timeout --memory --program --file)" ;;
    esac
    shift 2
  done
  [ "${1:-}" = -- ] || stage_die "no commands: end the arguments with -- 'COMMAND LINE'..."
  shift
  [ $# -gt 0 ] || stage_die "no command lines after --"
  commands=
  for line in "$@"; do commands=$commands$line$newline; done
}

# stage_tests FOLDER: programs and files under their names, and `commands`, a script that stops at the first
# command line that fails.
stage_tests() {
  printf '%s' "$programs" | while IFS= read -r program; do
    [ -x "$program" ] || stage_die "no program $program (build it first)"
    cp "$program" "$1/"
  done || exit 1
  printf '%s' "$files" | while IFS= read -r file; do
    from=${file%%:*}
    to=${file#*:}
    [ "$to" = "$file" ] && to=$(basename "$from")
    [ -e "$from" ] || stage_die "no file $from"
    mkdir -p "$1/$(dirname "$to")"
    cp -r "$from" "$1/$to"
  done || exit 1
  { echo 'set -e'; printf '%s' "$commands"; } >"$1/commands"
}
