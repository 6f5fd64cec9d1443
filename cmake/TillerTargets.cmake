# One CMake target per folder. An include of a folder that is not in DEPENDS fails to build, because
# each library offers its headers through an include root of its own (see tiller_library).

include(GNUInstallDirs)

set(CMAKE_C_STANDARD 99)
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
set(CMAKE_CXX_EXTENSIONS OFF)
if(CMAKE_SYSTEM_NAME STREQUAL "Generic")
  set(CMAKE_POSITION_INDEPENDENT_CODE OFF)  # an image at a fixed address
else()
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
endif()
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

add_library(tiller_flags INTERFACE)
target_compile_options(tiller_flags INTERFACE -Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion)
if(TILLER_SANITIZE)
  add_compile_options(-fsanitize=${TILLER_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -g1)
  add_link_options(-fsanitize=${TILLER_SANITIZE})
  if(TILLER_SANITIZE MATCHES "undefined")
    add_compile_options(-fno-sanitize=vptr)  # asks for type information, which the runtime is compiled without
  endif()
endif()
if(TILLER_COVERAGE)
  add_compile_options(--coverage)
  add_link_options(--coverage)
endif()
if(TILLER_CALL_GRAPH)
  add_compile_options(-fdump-tree-optimized)  # the types of calls through pointers
endif()
if(TILLER_MCDC)
  # Folders and their tests alone: an inline function counts in the copy that the linker keeps, which is the test's.
  set(TILLER_MCDC_OPTIONS -fprofile-instr-generate -fcoverage-mapping -fcoverage-mcdc)
  add_link_options(-fprofile-instr-generate)
endif()
if(TILLER_REPRODUCIBLE)
  add_compile_options(-ffp-contract=off)
endif()

# What runtime code is compiled with: no exceptions, no RTTI, and never -ffast-math (NaN checks must work).
set(TILLER_RUNTIME_OPTIONS $<$<COMPILE_LANGUAGE:CXX>:-fno-exceptions -fno-rtti>)

# tiller_precompile(target name header libs ...): the target's C++ begins with `header`, which is parsed once for all
# targets of one kind that name it so. A file includes what it needs all the same: builds through a compiler cache,
# which does not go together with this, are without.
function(tiller_precompile target name header)
  get_target_property(sources ${target} SOURCES)
  if(CMAKE_CXX_COMPILER_LAUNCHER OR CMAKE_CROSSCOMPILING OR NOT TILLER_PRECOMPILED OR sources MATCHES "[.]c(;|$)")
    return()
  endif()
  if(NOT TARGET ${name})
    set(source ${PROJECT_BINARY_DIR}/precompiled/${name}.cpp)
    file(CONFIGURE OUTPUT ${source} CONTENT "// nothing: see tiller_precompile\n" @ONLY)
    get_target_property(kind ${target} TYPE)
    if(kind STREQUAL "EXECUTABLE")  # compiled with other options than a library
      add_executable(${name} EXCLUDE_FROM_ALL ${source})
    else()
      add_library(${name} OBJECT EXCLUDE_FROM_ALL ${source})
    endif()
    target_link_libraries(${name} PRIVATE tiller_flags ${ARGN})
    target_precompile_headers(${name} PRIVATE "$<$<COMPILE_LANGUAGE:CXX>:${header}>")
    get_target_property(options ${target} COMPILE_OPTIONS)
    if(options)
      target_compile_options(${name} PRIVATE ${options})
    endif()
  endif()
  target_precompile_headers(${target} REUSE_FROM ${name})
endfunction()

# tiller_library(name [UNINSTALLED] SOURCES a.cpp ... DEPENDS core scalar ...)
#
# Makes the static library tiller_<name> from runtime/<name>. Its headers are included as
# "<name>/file.hpp"; the include root is a folder of links that holds that one name, so that a folder
# that is not in DEPENDS cannot be included by accident.
function(tiller_library name)
  cmake_parse_arguments(ARG "UNINSTALLED" "" "SOURCES;DEPENDS;PRIVATE_LIBS;PUBLIC_LIBS" ${ARGN})
  set(target tiller_${name})
  set(root ${PROJECT_BINARY_DIR}/include_roots/${name})
  file(MAKE_DIRECTORY ${root})
  if(NOT EXISTS ${root}/${name})
    file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR} ${root}/${name} SYMBOLIC)
  endif()
  if(ARG_SOURCES)
    add_library(${target} STATIC ${ARG_SOURCES})
    set(scope PUBLIC)
    target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:tiller_flags> ${ARG_PRIVATE_LIBS})
    target_compile_options(${target} PRIVATE ${TILLER_RUNTIME_OPTIONS})
    if(TILLER_SANITIZE MATCHES "fuzzer" AND name MATCHES "^(rollout|posterior|planners|executive|abi)$")
      # Told of every comparison, a fuzzer spends half of a tick on it. Settings are chosen by name, not guessed.
      target_compile_options(${target} PRIVATE -O2 -fno-sanitize-coverage=trace-cmp)
    endif()
    if(name IN_LIST TILLER_MCDC)
      target_compile_options(${target} PRIVATE ${TILLER_MCDC_OPTIONS})
    endif()
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(${target} ${scope}
    $<BUILD_INTERFACE:${root}>
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/runtime/include>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/tiller/runtime>)
  foreach(dep IN LISTS ARG_DEPENDS)
    target_link_libraries(${target} ${scope} tiller_${dep})
  endforeach()
  target_link_libraries(${target} ${scope} ${ARG_PUBLIC_LIBS})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  add_library(tiller::${name} ALIAS ${target})
  if(NOT ARG_UNINSTALLED)
    set_property(GLOBAL APPEND PROPERTY TILLER_RUNTIME_TARGETS ${target})
  endif()
endfunction()

# tiller_catalogue(folder macro): <folder>/catalogue.hpp, which includes the header of every line of
# tiller/<folder>.def: one more of its kind is one header and one line. The global property TILLER_CATALOGUES lists the
# folders in which a compiler finds them.
function(tiller_catalogue folder macro)
  set(def ${PROJECT_SOURCE_DIR}/runtime/include/tiller/${folder}.def)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${def})
  file(STRINGS ${def} lines REGEX "^${macro}\\(")
  set(includes "#pragma once\n#include \"tiller/scalar.hpp\"\n")
  foreach(line IN LISTS lines)
    string(REGEX REPLACE "^${macro}\\(([a-z0-9_]+),.*" "\\1" name "${line}")
    string(APPEND includes "#include \"${folder}/${name}.hpp\"\n")
  endforeach()
  set(header ${PROJECT_BINARY_DIR}/generated/${folder}/${folder}/catalogue.hpp)
  file(CONFIGURE OUTPUT ${header} CONTENT "${includes}" @ONLY)
  install(FILES ${header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/tiller/runtime/${folder})
  set_property(GLOBAL APPEND PROPERTY TILLER_CATALOGUES ${PROJECT_BINARY_DIR}/generated/${folder})
endfunction()

# tiller_include_root(result folder): a folder of links, in the build, through which the headers of this one folder of
# the tree are included by their path.
function(tiller_include_root result folder)
  string(REPLACE "/" "_" id ${folder})
  set(root ${PROJECT_BINARY_DIR}/include_roots/${id})
  get_filename_component(above ${root}/${folder} DIRECTORY)
  file(MAKE_DIRECTORY ${above})
  if(NOT EXISTS ${root}/${folder})
    file(CREATE_LINK ${PROJECT_SOURCE_DIR}/${folder} ${root}/${folder} SYMBOLIC)
  endif()
  set(${result} ${root} PARENT_SCOPE)
endfunction()

# Code of texts and files, which runs once: half the size, and a third of the compile time less, than what computes.
set(TILLER_SMALL $<$<CONFIG:Release>:-Os>)

# tiller_small_sources(file.cpp ...): files of texts in a module that computes.
function(tiller_small_sources)
  # A precompiled header is for the options that it was compiled with.
  set_source_files_properties(${ARGN} PROPERTIES COMPILE_OPTIONS ${TILLER_SMALL} SKIP_PRECOMPILE_HEADERS ON)
endfunction()

# tiller_module(folder [SMALL] SOURCES a.cpp ... DEPENDS folder ... PRIVATE_LIBS ... PUBLIC_LIBS ...)
#
# Makes the static library of a folder outside of runtime: tools/gap/fit gives tiller_tools_gap_fit. Its headers are
# included by their path, "tools/gap/fit/file.hpp"; the include root is a folder of links that holds that one path, so
# that a folder that is not in DEPENDS, or below one that is, cannot be included by accident. SMALL: all of it is texts
# and files.
function(tiller_module folder)
  cmake_parse_arguments(ARG "SMALL" "" "SOURCES;DEPENDS;PRIVATE_LIBS;PUBLIC_LIBS" ${ARGN})
  string(REPLACE "/" "_" id ${folder})
  tiller_include_root(root ${folder})
  set(scope PUBLIC)
  if(ARG_SOURCES)
    add_library(tiller_${id} STATIC ${ARG_SOURCES})
    target_link_libraries(tiller_${id} PRIVATE tiller_flags ${ARG_PRIVATE_LIBS})
    if(ARG_SMALL)
      target_compile_options(tiller_${id} PRIVATE ${TILLER_SMALL})
    elseif("Eigen3::Eigen" IN_LIST ARG_PRIVATE_LIBS OR "Eigen3::Eigen" IN_LIST ARG_PUBLIC_LIBS)
      tiller_precompile(tiller_${id} tiller_eigen_headers "<Eigen/Dense>" Eigen3::Eigen)
    endif()
  else()
    add_library(tiller_${id} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(tiller_${id} ${scope} $<BUILD_INTERFACE:${root}>)
  list(TRANSFORM ARG_DEPENDS REPLACE "/" "_")
  list(TRANSFORM ARG_DEPENDS PREPEND tiller_)
  target_link_libraries(tiller_${id} ${scope} ${ARG_DEPENDS} ${ARG_PUBLIC_LIBS})
endfunction()

# tiller_read_table(file.def MACRO wanted built definitions): the names that a table lists as MACRO(name, ...), of which
# a build with a list `wanted` has those alone. Sets `built` to the names and `definitions` to
# TILLER_BUILT_<what>_<name>=0 or 1.
function(tiller_read_table file macro option built definitions)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
  file(STRINGS ${file} lines REGEX "^${macro}\\(")
  string(REPLACE "TILLER_" "TILLER_BUILT_" prefix ${macro})
  set(known "")
  set(names "")
  set(all "")
  foreach(line IN LISTS lines)
    string(REGEX REPLACE "^${macro}\\(([a-z0-9_]+),.*" "\\1" name "${line}")
    list(APPEND known ${name})
    set(has 0)
    if(NOT ${option} OR name IN_LIST ${option})
      set(has 1)
      list(APPEND names ${name})
    endif()
    list(APPEND all ${prefix}_${name}=${has})
  endforeach()
  foreach(name IN LISTS ${option})
    if(NOT name IN_LIST known)
      message(FATAL_ERROR "${option}: '${name}' is not in ${file}, which has ${known}")
    endif()
  endforeach()
  set(${built} ${names} PARENT_SCOPE)
  set(${definitions} ${all} PARENT_SCOPE)
endfunction()

# tiller_knows_copies(target): scalar/isa_copies.hpp names the instruction sets of this build in the target's sources.
function(tiller_knows_copies target)
  cmake_parse_arguments(ARG "" "" "ISAS" ${ARGN})
  if(NOT ARG_ISAS)
    set(ARG_ISAS ${TILLER_ISAS})
  endif()
  list(TRANSFORM ARG_ISAS PREPEND TILLER_HAS_ISA_ OUTPUT_VARIABLE built_isas)
  target_compile_definitions(${target} PRIVATE ${built_isas})
endfunction()

# tiller_isa_sources(target file.cpp ... [ISAS isa ...] [OPTIMISATION flag])
#
# Compiles each file once per instruction set (of the build, or of ISAS), with TILLER_COMPILE_ISA set to its name (see
# scalar/isa.hpp), at -O3: at -O2 a cart-pole's kernel takes a quarter less time to compile and 1.5 times the
# instructions to plan. OPTIMISATION: another one in release builds, for models that only a test rolls out. The flags never reach any other file, and these copies are optimised even in debug
# builds: an inline function of the standard library that is emitted out of line in the AVX-512 copy could be
# the one the linker keeps for everybody.
if(TILLER_REPRODUCIBLE)
  set(TILLER_ISAS scalar)
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set(TILLER_ISAS sse2 avx2 avx512)
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
  set(TILLER_ISAS neon)
else()
  set(TILLER_ISAS scalar)
endif()
# A build for one known processor may leave copies out. The baseline and this processor's best are built: the third
# copy is a third of the kernels' compile time, and tests cannot run what the processor cannot. A build server adds
# AVX2, which its tests emulate. Whoever ships binaries wants all.
if(TILLER_ISA_ONLY AND NOT TILLER_ISA_ONLY STREQUAL "all")
  set(TILLER_ISAS ${TILLER_ISA_ONLY})
elseif(NOT TILLER_ISA_ONLY AND NOT CMAKE_CROSSCOMPILING AND EXISTS /proc/cpuinfo
       AND "avx512" IN_LIST TILLER_ISAS)
  file(STRINGS /proc/cpuinfo processor REGEX "^flags" LIMIT_COUNT 1)
  string(REPLACE " " ";" processor "${processor}")
  function(tiller_processor_has result)
    set(${result} TRUE PARENT_SCOPE)
    foreach(flag IN LISTS ARGN)
      if(NOT flag IN_LIST processor)
        set(${result} FALSE PARENT_SCOPE)
      endif()
    endforeach()
  endfunction()
  tiller_processor_has(has_avx512 avx512f avx512cd avx512dq avx512bw avx512vl)
  tiller_processor_has(has_avx2 avx2 fma)
  if(has_avx512 AND NOT DEFINED ENV{CI})
    set(TILLER_ISAS sse2 avx512)
  elseif(has_avx512)
    set(TILLER_EMULATED_ISA avx2)  # of few models: tests run it under an emulator, the processor itself never
  elseif(has_avx2 AND NOT has_avx512)
    set(TILLER_ISAS sse2 avx2)
  endif()
endif()
list(GET TILLER_ISAS 0 TILLER_FIRST_ISA)
list(GET TILLER_ISAS -1 TILLER_BEST_ISA)
set(TILLER_ISA_FLAGS_scalar -Wno-narrowing)  # & of two bools is an int
set(TILLER_ISA_FLAGS_sse2 -msse2)
set(TILLER_ISA_FLAGS_avx2 -mavx2 -mfma)
set(TILLER_ISA_FLAGS_avx512 -mavx512f -mavx512cd -mavx512dq -mavx512bw -mavx512vl -mfma -mprefer-vector-width=512)
# GCC takes derivatives that a masked dual does not have, and what its own AVX-512 headers leave open, for read.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  set(TILLER_ISA_QUIET -Wno-uninitialized -Wno-maybe-uninitialized)
endif()
if(TILLER_SANITIZE OR TILLER_COVERAGE OR TILLER_MCDC)
  # Fully optimised, an instrumented kernel compiles for minutes; unoptimised, its statistical tests run for an hour.
  set(TILLER_ISA_OPTIMISATION -O1 -g1)
  if(TILLER_SANITIZE MATCHES "undefined")
    # AddressSanitizer finds what these three would, and they make up half of a kernel's code.
    list(APPEND TILLER_ISA_OPTIMISATION -fno-sanitize=null,alignment,object-size)
  endif()
  if(TILLER_SANITIZE MATCHES "address")
    # A kernel's temporaries are its registers: what they are worth is nothing that one could overrun, and marking them
    # takes ten times as long as using them. Accesses by pointer and by index stay checked.
    list(APPEND TILLER_ISA_OPTIMISATION --param=asan-stack=0 -fno-sanitize-address-use-after-scope
      -finline-small-functions -finline-functions)
  endif()
  list(LENGTH TILLER_ISAS copies)
  if(copies EQUAL 1)
    # Forced inlining makes it ten times as much code: what one copy does not need, since nobody shares its functions.
    add_compile_definitions(TILLER_PLAIN_CALLS)
  endif()
  if(TILLER_SANITIZE MATCHES "fuzzer")
    # Counted along, the kernels' many branches would cost a fuzzer more than what it tests; they see checked numbers.
    list(APPEND TILLER_ISA_OPTIMISATION -fno-sanitize=${TILLER_SANITIZE})
  endif()
elseif(TILLER_KERNEL_OPTIMISATION)
  set(TILLER_ISA_OPTIMISATION ${TILLER_KERNEL_OPTIMISATION})
else()
  set(TILLER_ISA_OPTIMISATION -O3)
endif()
function(tiller_isa_sources target)
  cmake_parse_arguments(ARG "" "OPTIMISATION" "ISAS" ${ARGN})
  if(NOT ARG_ISAS)
    set(ARG_ISAS ${TILLER_ISAS})
  endif()
  set(optimisation ${TILLER_ISA_OPTIMISATION})
  if(ARG_OPTIMISATION AND optimisation STREQUAL "-O3")
    set(optimisation ${ARG_OPTIMISATION})
  endif()
  tiller_knows_copies(${target} ISAS ${ARG_ISAS})
  foreach(source IN LISTS ARG_UNPARSED_ARGUMENTS)
    get_filename_component(stem ${source} NAME_WE)
    get_filename_component(path ${source} ABSOLUTE)
    foreach(isa IN LISTS ARG_ISAS)
      set(copy ${CMAKE_CURRENT_BINARY_DIR}/${stem}_${isa}.cpp)
      file(CONFIGURE OUTPUT ${copy} CONTENT "#include \"${path}\"  // NOLINT(bugprone-suspicious-include)\n" @ONLY)
      set_source_files_properties(${copy} PROPERTIES
        SKIP_PRECOMPILE_HEADERS ON  # of other flags; GCC 12 crashes
        COMPILE_OPTIONS "${optimisation};${TILLER_ISA_FLAGS_${isa}};${TILLER_ISA_QUIET}"
        COMPILE_DEFINITIONS "TILLER_COMPILE_ISA=${isa};TILLER_COMPILE_ISA_${isa}=1")
      target_sources(${target} PRIVATE ${copy})
    endforeach()
  endforeach()
endfunction()

# tiller_test(name SOURCES a_test.cpp ... LIBS tiller_core ... LABELS slow)
#
# A GoogleTest program registered with ctest as <name>. Every test prints what it measured. Files of testing::TempDir()
# are in a folder of its own: another test, preset or checkout that runs at the same time has others. The label threads:
# it has some (the target threaded builds these).
function(tiller_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;LIBS;LABELS;ARGS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  # A fifth of the compile time less; what is tested is optimised as ever, and so are a test's own kernels.
  target_compile_options(${name} PRIVATE $<$<CONFIG:Release>:-O1>)
  target_link_libraries(${name} PRIVATE tiller_flags ${ARG_LIBS} $<TARGET_NAME_IF_EXISTS:tiller_builtin>
    GTest::gtest GTest::gtest_main)
  tiller_precompile(${name} tiller_test_headers "<gtest/gtest.h>" GTest::gtest_main)
  add_test(NAME ${name} COMMAND ${name} ${ARG_ARGS})
  if(NOT ARG_TIMEOUT) # ten times the longest of them on a quiet machine: a busy one fails no test
    set(ARG_TIMEOUT 900)
  endif()
  if(CMAKE_CROSSCOMPILING_EMULATOR OR TILLER_SANITIZE OR TILLER_COVERAGE OR TILLER_MCDC) # some twenty times slower
    math(EXPR ARG_TIMEOUT "10 * ${ARG_TIMEOUT}")
  endif()
  set(folder ${CMAKE_CURRENT_BINARY_DIR}/${name}_files)
  file(MAKE_DIRECTORY ${folder})
  set_tests_properties(${name} PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT ${ARG_TIMEOUT}
    ENVIRONMENT "TEST_TMPDIR=${folder}")
  if("threads" IN_LIST ARG_LABELS)
    tiller_threaded(${name})
  endif()
endfunction()

# tiller_threaded(target...): programs of tests labelled threads, for ThreadSanitizer.
function(tiller_threaded)
  if(NOT TARGET threaded)
    add_custom_target(threaded)
  endif()
  add_dependencies(threaded ${ARGN})
endfunction()
