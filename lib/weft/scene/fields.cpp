#include "weft/scene/fields.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "weft/error.hpp"

namespace weft {
namespace {

// Sharper lobes than this need more samples per texel than anyone waits for.
constexpr double least_roughness = 0.02;

}  // namespace

void Fields::number(std::string_view name, float& value, double low, double high,
                    std::string_view meaning) {
  double wide = value;
  number(name, wide, low, high, meaning);
  value = static_cast<float>(wide);
}

void describe_gloss(Fields& fields, GlossyLobe& gloss) {
  fields.open("gloss", "microfacet lobe");
  fields.color("f0", gloss.f0, "reflectance at normal incidence");
  fields.number("f90", gloss.f90, 0, 1, "reflectance at grazing incidence");
  fields.number("alpha_along", gloss.alpha_along, least_roughness, 1,
                "roughness along the fibres or the grain");
  fields.number("alpha_across", gloss.alpha_across, least_roughness, 1, "roughness across them");
  fields.close();
}

void FieldPath::push(std::string_view name) {
  parts_.push_back(of(name));
}

void FieldPath::push(std::size_t index) {
  parts_.push_back(fmt::format("{}[{}]", text(), index));
}

std::string FieldPath::of(std::string_view name) const {
  if (parts_.empty() || name.empty()) return parts_.empty() ? std::string(name) : parts_.back();
  return fmt::format("{}.{}", parts_.back(), name);
}

std::string FieldPath::text() const {
  return parts_.empty() ? std::string() : parts_.back();
}

void FieldChecker::number(std::string_view name, double& value, double low, double high,
                          std::string_view /*meaning*/) {
  // Written so that NaN fails. A float may be a rounding away from the bound it was set to.
  const double slack = 1e-7 * (high - low);
  if (!(value >= low - slack && value <= high + slack)) {
    fail_input("{}: {} is {}, outside [{}, {}]", what_, path_.of(name), value, low, high);
  }
}

void FieldChecker::count(std::string_view name, std::size_t& value, std::size_t low,
                         std::size_t high, std::string_view /*meaning*/) {
  if (value < low || value > high) {
    fail_input("{}: {} is {}, outside [{}, {}]", what_, path_.of(name), value, low, high);
  }
}

void FieldChecker::color(std::string_view name, std::array<float, 3>& value,
                         std::string_view /*meaning*/) {
  for (const float channel : value) {
    if (!(channel >= 0 && channel <= 1)) {
      fail_input("{}: {} is {}, outside [0, 1]", what_, path_.of(name), channel);
    }
  }
}

void FieldChecker::tile(std::array<double, 2>& value, double low, double high,
                        std::string_view meaning) {
  for (double& side : value) number("tile", side, low, high, meaning);
}

std::size_t FieldChecker::open_list(std::string_view name, std::size_t size, std::size_t least,
                                    std::size_t most, std::string_view /*meaning*/) {
  if (size < least || size > most) {
    fail_input("{}: {} has {} entries, not {} to {}", what_, path_.of(name), size, least, most);
  }
  path_.push(name);
  return size;
}

void FieldLister::add(std::string_view name, std::string accepts, std::string standard,
                      std::string_view meaning) {
  rows_.push_back({path_.of(name), std::move(accepts), std::move(standard), std::string(meaning)});
}

void FieldLister::number(std::string_view name, double& value, double low, double high,
                         std::string_view meaning) {
  add(name, fmt::format("{} to {}", low, high), fmt::format("{:.4g}", value), meaning);
}

void FieldLister::count(std::string_view name, std::size_t& value, std::size_t low,
                        std::size_t high, std::string_view meaning) {
  add(name, fmt::format("{} to {}, whole", low, high), fmt::format("{}", value), meaning);
}

void FieldLister::seed(std::uint64_t& value) {
  add("seed", "0 to 2^64 - 1, whole", fmt::format("{}", value), "of all irregularities");
}

void FieldLister::color(std::string_view name, std::array<float, 3>& value,
                        std::string_view meaning) {
  add(name, "3 numbers, 0 to 1", fmt::format("[{:.3g}]", fmt::join(value, ", ")), meaning);
}

void FieldLister::tile(std::array<double, 2>& value, double low, double high,
                       std::string_view meaning) {
  add("tile", fmt::format("2 numbers, {} to {}", low, high),
      fmt::format("[{:.4g}]", fmt::join(value, ", ")), meaning);
}

void FieldLister::open(std::string_view name, std::string_view meaning) {
  add(name, "object", "", meaning);
  path_.push(name);
}

std::size_t FieldLister::open_list(std::string_view name, std::size_t size, std::size_t least,
                                   std::size_t most, std::string_view meaning) {
  add(name, fmt::format("list of {} to {} objects", least, most), fmt::format("{} entries", size),
      meaning);
  path_.push(fmt::format("{}[]", name));
  // One entry shows what all of them may have.
  return 1;
}

}  // namespace weft
