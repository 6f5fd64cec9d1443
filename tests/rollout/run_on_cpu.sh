#!/bin/sh
# run_on_cpu.sh MODEL PROGRAM [ARGS]: runs a program on an emulated processor that stops at every instruction which
# that model does not have. The proof that code for newer instruction sets does not leak out of its own copies.
model=$1
shift
if ! command -v qemu-x86_64 >/dev/null 2>&1; then
  echo "qemu-x86_64 is missing: install qemu-user (./dev setup does)" >&2
  exit 1
fi
exec qemu-x86_64 -cpu "$model" "$@"
