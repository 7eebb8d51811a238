#include "weft/codecs/codec.hpp"

#include <algorithm>
#include <array>
#include <charconv>

#include "weft/codecs/lpca.hpp"
#include "weft/codecs/pca.hpp"
#include "weft/codecs/sparse.hpp"
#include "weft/codecs/tt.hpp"
#include "weft/codecs/tucker.hpp"
#include "weft/codecs/view_pca.hpp"
#include "weft/error.hpp"
#include "weft/reference/lookup.hpp"

namespace weft {

std::unique_ptr<ReferenceSampler> Codec::reference_sampler(const Model& model) const {
  return reference::texel_sampler(model);
}

std::unique_ptr<Model> Codec::next_mip_level(const Model& model) const {
  (void)model;
  return nullptr;
}

// A decoded value is a sum of n >= 1 terms, whose bound is gamma_n times their magnitude. Weights
// join m = T + V L + 2 roundings to each term, in whatever order the sums are taken, and
// gamma_{n + m} <= (1 + m) gamma_n / (1 - m n u), where one more covers the denominator.
double lookup_tolerance(const Codec& codec, const Model& model, const LookupShape& lookup) {
  return static_cast<double>(lookup.texels + lookup.views * lookup.lights + 4) *
         codec.decode_tolerance(model);
}

std::span<const Codec* const> codecs() {
  static const std::array<const Codec*, 6> table{&pca_codec(),  &view_pca_codec(),
                                                 &lpca_codec(), &sparse_codec(),
                                                 &tt_codec(),   &tucker_codec()};
  return table;
}

const Codec& find_codec(std::string_view name) {
  std::string names;
  for (const Codec* codec : codecs()) {
    if (codec->name() == name) return *codec;
    names += (names.empty() ? "" : ", ") + std::string(codec->name());
  }
  fail_input("codec '{}': there is none of that name, only {}", name, names);
}

std::unique_ptr<Model> read_model(const std::filesystem::path& path) {
  const ModelFile file(path);
  const auto table = codecs();
  const auto known = std::find_if(table.begin(), table.end(), [&](const Codec* codec) {
    return codec->name() == file.info().codec;
  });
  if (known == table.end()) {
    file.reject(fmt::format("codec '{}' is not one of this version", file.info().codec));
  }
  return (*known)->read(file);
}

std::size_t count_parameter(const Codec& codec, const Parameters& parameters, std::string_view name,
                            std::size_t least) {
  const auto specs = codec.parameters();
  const auto spec = std::find_if(specs.begin(), specs.end(),
                                 [&](const ParameterSpec& s) { return s.name == name; });
  const auto given = parameters.find(name);
  const std::string text =
      given != parameters.end() ? given->second : std::string(spec->default_value);
  std::size_t value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, status] = std::from_chars(text.data(), end, value);
  if (status != std::errc() || stop != end || value < least) {
    fail_input("--{} {}: a whole number of at least {} is needed", name, text, least);
  }
  return value;
}

}  // namespace weft
