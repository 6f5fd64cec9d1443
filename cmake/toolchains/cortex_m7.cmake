# Cortex-M7 with its double-precision unit, no operating system (Debian: gcc-arm-none-eabi,
# libstdc++-arm-none-eabi-newlib, qemu-system-arm). Only the runtime without io is built, for size.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR cortex-m7)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)  # a program needs the board's own start-up
set(processor "-mcpu=cortex-m7 -mthumb -mfloat-abi=hard -mfpu=fpv5-d16 -ffunction-sections -fdata-sections")
set(CMAKE_C_FLAGS_INIT "${processor}")
# no locks around function-local statics and no exit handlers: there is one thread, and it never ends
set(CMAKE_CXX_FLAGS_INIT "${processor} -fno-threadsafe-statics -fno-use-cxa-atexit -Wno-psabi")
# in the cache: CMake appends its own -O3 to what the _INIT variables say, and the last option counts
set(CMAKE_C_FLAGS_RELEASE "-Os -DNDEBUG" CACHE STRING "")
set(CMAKE_CXX_FLAGS_RELEASE "-Os -DNDEBUG" CACHE STRING "")
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE BOTH)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE BOTH)
