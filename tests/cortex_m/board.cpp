#include "board.hpp"

// Of the linker script.
extern "C" {
extern std::uint32_t link_data_load[], link_data_begin[], link_data_end[], link_bss_begin[], link_bss_end[];
extern std::uint32_t link_stack_low[], link_stack_top[], link_flash_begin[], link_flash_end[];
extern void (*link_init_begin[])();
extern void (*link_init_end[])();
int main();
void reset_handler();
void fault_handler();
void __cxa_pure_virtual();
}

namespace {

constexpr std::uint32_t kPaint = 0xc0dec0deu;

/// Semihosting for AArch32 M profile ("Semihosting for AArch32 and AArch64", Arm IHI 0067): operation in r0, its
/// parameter block in r1.
std::uint32_t semihost(std::uint32_t operation, const void* parameters) {
  register std::uint32_t r0 asm("r0") = operation;
  register const void* r1 asm("r1") = parameters;
  asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}
constexpr std::uint32_t kWrite0 = 0x04, kGetCommandLine = 0x15, kExitExtended = 0x20;
constexpr std::uint32_t kApplicationExit = 0x20026;

volatile std::uint32_t& reg(std::uint32_t address) { return *reinterpret_cast<volatile std::uint32_t*>(address); }
constexpr std::uint32_t kCoprocessorAccess = 0xe000ed88;  // CPACR, ARMv7-M B3.2.20
constexpr std::uint32_t kTimerControl = 0x40000000, kTimerValue = 0x40000004, kTimerReload = 0x40000008;

}  // namespace

namespace board {

void print(const char* text) { (void)semihost(kWrite0, text); }

void print_number(std::uint64_t value) {
  char digits[21];
  char* at = digits + sizeof digits - 1;
  *at = '\0';
  do {
    *--at = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value != 0);
  print(at);
}

std::size_t arguments(std::uint32_t* values, std::size_t room) {
  static char line[512];
  struct {
    char* text;
    std::uint32_t size;
  } parameters = {line, sizeof line - 1};
  if (semihost(kGetCommandLine, &parameters) != 0) return 0;
  std::size_t count = 0;
  const char* at = line;
  while (*at != '\0' && *at != ' ') ++at;  // the program's name
  while (*at != '\0' && count < room) {
    std::uint32_t value = 0;
    bool found = false;
    for (; *at != '\0' && *at != ' '; ++at) {
      if (*at < '0' || *at > '9') continue;
      value = 10 * value + static_cast<std::uint32_t>(*at - '0');
      found = true;
    }
    if (found) values[count++] = value;
    if (*at == ' ') ++at;
  }
  return count;
}

void leave(int code) {
  const std::uint32_t parameters[2] = {kApplicationExit, static_cast<std::uint32_t>(code)};
  for (;;) (void)semihost(kExitExtended, parameters);
}

void start_timer() {
  reg(kTimerControl) = 0;
  reg(kTimerReload) = 0xffffffffu;
  reg(kTimerValue) = 0xffffffffu;
  reg(kTimerControl) = 1;
}
std::uint32_t timer() { return reg(kTimerValue); }

std::size_t stack_used() {
  const std::uint32_t* at = link_stack_low;
  while (at < link_stack_top && *at == kPaint) ++at;
  return static_cast<std::size_t>(reinterpret_cast<std::uintptr_t>(link_stack_top) -
                                  reinterpret_cast<std::uintptr_t>(at));
}
void paint_stack() {
  std::uint32_t* here;
  asm volatile("mov %0, sp" : "=r"(here));
  for (std::uint32_t* at = link_stack_low; at < here - 8; ++at) *const_cast<volatile std::uint32_t*>(at) = kPaint;
}
std::size_t stack_above(const void* place) {
  return reinterpret_cast<std::uintptr_t>(link_stack_top) - reinterpret_cast<std::uintptr_t>(place);
}
std::size_t stack_size() {
  return reinterpret_cast<std::uintptr_t>(link_stack_top) - reinterpret_cast<std::uintptr_t>(link_stack_low);
}
std::size_t data_size() {
  return reinterpret_cast<std::uintptr_t>(link_bss_end) - reinterpret_cast<std::uintptr_t>(link_data_begin);
}
std::size_t flash_size() {
  return reinterpret_cast<std::uintptr_t>(link_flash_end) - reinterpret_cast<std::uintptr_t>(link_flash_begin);
}

}  // namespace board

// A class with pure virtual functions names this; reached only by our own bug.
void __cxa_pure_virtual() {
  board::print("pure virtual call\n");
  board::leave(3);
}

void fault_handler() {
  board::print("fault\n");
  board::leave(2);
}

// Runs before anything is initialised: no library calls, no statics.
void reset_handler() {
  reg(kCoprocessorAccess) |= 0xfu << 20;  // the floating-point unit, before any code that uses its registers
  asm volatile("dsb\nisb" ::: "memory");
  board::paint_stack();
  const std::uint32_t* from = link_data_load;
  for (std::uint32_t* to = link_data_begin; to < link_data_end; ++to)
    *const_cast<volatile std::uint32_t*>(to) = *from++;
  for (std::uint32_t* to = link_bss_begin; to < link_bss_end; ++to) *const_cast<volatile std::uint32_t*>(to) = 0;
  for (void (**init)() = link_init_begin; init < link_init_end; ++init) (*init)();
  board::leave(main());
}

extern "C" {
/// Stack and handlers, ARMv7-M B1.5.3; interrupts are never enabled.
__attribute__((section(".vectors"), used)) const std::uintptr_t vectors[16] = {
    reinterpret_cast<std::uintptr_t>(link_stack_top), reinterpret_cast<std::uintptr_t>(&reset_handler),
    reinterpret_cast<std::uintptr_t>(&fault_handler), reinterpret_cast<std::uintptr_t>(&fault_handler),
    reinterpret_cast<std::uintptr_t>(&fault_handler), reinterpret_cast<std::uintptr_t>(&fault_handler),
    reinterpret_cast<std::uintptr_t>(&fault_handler),
};
}
