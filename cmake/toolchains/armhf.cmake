# 32-bit Arm Linux with a floating-point unit (Debian: g++-arm-linux-gnueabihf, qemu-user). Tests run under qemu-user.
# One lane: NEON of 32-bit Arm has no doubles and flushes denormals.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR armv7l)
set(CMAKE_C_COMPILER arm-linux-gnueabihf-gcc)
set(CMAKE_CXX_COMPILER arm-linux-gnueabihf-g++)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-arm;-L;/usr/arm-linux-gnueabihf)
# GCC notes that the ABI of some structures changed in version 7; nothing here was built before.
set(CMAKE_CXX_FLAGS_INIT -Wno-psabi)
# Libraries are the target's alone; what is headers only (Eigen, xsimd, toml++) is the desk's.
set(CMAKE_FIND_ROOT_PATH /usr/arm-linux-gnueabihf)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE BOTH)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE BOTH)
