// Many floats, in memory or in a temporary file that is mapped: what a job must keep beyond its
// memory bound lies in pages that the system can write back, and its code sees neighbours in memory
// all the same. The file has no name, in TMPDIR or /tmp, and goes with the process.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace weft {

class FloatStore {
 public:
  enum class Place { memory, file };

  FloatStore() = default;
  // `count` zeros. Throws a run-time error that names the folder and the size where there is no
  // room.
  explicit FloatStore(std::size_t count, Place place = Place::memory);
  // Copies them to memory.
  FloatStore(const std::vector<float>& values);
  ~FloatStore();
  // In the same place.
  FloatStore(const FloatStore& other);
  FloatStore(FloatStore&& other) noexcept { swap(other); }
  FloatStore& operator=(FloatStore other) noexcept {
    swap(other);
    return *this;
  }

  Place place() const { return place_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  float* data() { return data_; }
  const float* data() const { return data_; }
  float* begin() { return data_; }
  const float* begin() const { return data_; }
  float* end() { return data_ + size_; }
  const float* end() const { return data_ + size_; }
  float& operator[](std::size_t i) { return data_[i]; }
  const float& operator[](std::size_t i) const { return data_[i]; }

  // Keeps the first `count` and gives back the rest.
  void shrink(std::size_t count);

  // Gives back what is resident of a file; the values stay in it. Nothing in memory.
  void release() const;

  friend bool operator==(const FloatStore& a, const FloatStore& b);

 private:
  void swap(FloatStore& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(mapped_bytes_, other.mapped_bytes_);
    std::swap(place_, other.place_);
  }

  float* data_ = nullptr;
  std::size_t size_ = 0;
  std::size_t mapped_bytes_ = 0;
  Place place_ = Place::memory;
};

}  // namespace weft
