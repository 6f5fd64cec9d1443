# 64-bit Arm Linux (Debian: g++-aarch64-linux-gnu, qemu-user). Tests run under qemu-user.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64;-L;/usr/aarch64-linux-gnu)
# Libraries are the target's alone; what is headers only (Eigen, xsimd, toml++) is the desk's.
set(CMAKE_FIND_ROOT_PATH /usr/aarch64-linux-gnu)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE BOTH)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE BOTH)

# Debian packages of the target, unpacked (tools/dev/fetch_sysroot.sh): what the plants and the tools link.
set(TILLER_SYSROOT "" CACHE PATH "unpacked packages of the target")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES TILLER_SYSROOT)
if(TILLER_SYSROOT)
  list(APPEND CMAKE_FIND_ROOT_PATH ${TILLER_SYSROOT})
  set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
  set(ENV{PKG_CONFIG_LIBDIR} ${TILLER_SYSROOT}/usr/lib/aarch64-linux-gnu/pkgconfig)
  set(ENV{PKG_CONFIG_SYSROOT_DIR} ${TILLER_SYSROOT})
  # what these libraries need themselves
  set(CMAKE_EXE_LINKER_FLAGS_INIT "-Wl,-rpath-link,${TILLER_SYSROOT}/usr/lib/aarch64-linux-gnu")
  set(CMAKE_MODULE_LINKER_FLAGS_INIT "${CMAKE_EXE_LINKER_FLAGS_INIT}")
  set(CMAKE_SHARED_LINKER_FLAGS_INIT "${CMAKE_EXE_LINKER_FLAGS_INIT}")
endif()
