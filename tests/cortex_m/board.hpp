#pragma once

// The board: Arm MPS2 with the AN500 image (Cortex-M7), as qemu-system-arm -M mps2-an500 has it. Start-up, a console
// and arguments through semihosting, a timer, and the stack's high-water mark.

#include <cstddef>
#include <cstdint>

namespace board {

void print(const char* text);
void print_number(std::uint64_t value);
/// The numbers behind the program's name on the command line, at most `room` of them; how many there are.
std::size_t arguments(std::uint32_t* values, std::size_t room);
[[noreturn]] void leave(int code);

/// Counts down at 25 MHz of virtual time (CMSDK APB timer 0). Differences wrap at 2^32.
void start_timer();
std::uint32_t timer();

/// Bytes of the stack that were used since it was last painted below the caller (at first: by the start-up), and that
/// there are.
std::size_t stack_used();
void paint_stack();
/// Bytes from a place on the stack to its beginning.
std::size_t stack_above(const void* place);
std::size_t stack_size();
/// Bytes of initialised and zeroed data.
std::size_t data_size();
/// Bytes of code, constants and the image of the initialised data.
std::size_t flash_size();

}  // namespace board
