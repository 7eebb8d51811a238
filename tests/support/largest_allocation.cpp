#include "support/largest_allocation.hpp"

#include <atomic>
#include <cstdlib>
#include <new>

namespace weft::test {
namespace {
std::atomic<std::size_t> largest{0};
}

void reset_largest_allocation() {
  largest = 0;
}
std::size_t largest_allocation() {
  return largest;
}

void note_allocation(std::size_t bytes) {
  std::size_t before = largest;
  while (before < bytes && !largest.compare_exchange_weak(before, bytes)) {
  }
}

}  // namespace weft::test

void* operator new(std::size_t bytes) {
  weft::test::note_allocation(bytes);
  void* memory = std::malloc(bytes > 0 ? bytes : 1);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  weft::test::note_allocation(bytes);
  return std::malloc(bytes > 0 ? bytes : 1);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
