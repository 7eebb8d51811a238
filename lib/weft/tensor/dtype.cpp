#include "weft/tensor/dtype.hpp"

#include <array>

namespace weft {
namespace {
struct Row {
  std::string_view name;
  std::size_t size;
};
constexpr std::array<Row, 6> rows{
    {{"U8", 1}, {"U16", 2}, {"U32", 4}, {"F16", 2}, {"F32", 4}, {"F64", 8}}};
}  // namespace

std::size_t size_of(DType type) {
  return rows[static_cast<std::size_t>(type)].size;
}

std::string_view name_of(DType type) {
  return rows[static_cast<std::size_t>(type)].name;
}

std::optional<DType> dtype_from_name(std::string_view name) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].name == name) return static_cast<DType>(i);
  }
  return std::nullopt;
}

}  // namespace weft
