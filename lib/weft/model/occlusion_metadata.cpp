#include "weft/model/occlusion_metadata.hpp"

#include <limits>
#include <nlohmann/json.hpp>

#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {
namespace {

using nlohmann::json;

const json& field(const json& object, const char* key, const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) fail_input("{}: no \"{}\"", where, key);
  return *found;
}

std::string text_field(const json& object, const char* key, const std::string& where) {
  const json& value = field(object, key, where);
  if (!value.is_string()) fail_input("{}: \"{}\" is no text", where, key);
  return value.get<std::string>();
}

double number_field(const json& object, const char* key, const std::string& where) {
  const json& value = field(object, key, where);
  if (!value.is_number()) fail_input("{}: \"{}\" is no number", where, key);
  return value.get<double>();
}

std::size_t count_field(const json& object, const char* key, std::size_t most,
                        const std::string& where) {
  const json& value = field(object, key, where);
  if (!value.is_number_unsigned()) fail_input("{}: \"{}\" is no whole number", where, key);
  const auto count = value.get<std::size_t>();
  if (count > most) fail_input("{}: \"{}\": {} is more than {}", where, key, count, most);
  return count;
}

}  // namespace

std::string occlusion_json(const Occlusion& occlusion, const std::string& where) {
  const ModelInfo& info = occlusion.model->info;
  const json object{{"codec", info.codec},
                    {"of", name_of(occlusion.kind)},
                    {"parameters", parse_json(info.parameters, where + ": occlusion parameters")},
                    {"storage", info.storage == Storage::f16 ? "f16" : "f32"},
                    {"texels", occlusion.errors.texels},
                    {"error_texels", occlusion.errors.wrong},
                    {"threshold", occlusion.mapping.threshold},
                    {"weight", occlusion.mapping.weight}};
  return object.dump();
}

StoredOcclusion read_occlusion(std::string_view text, const BtfInfo& whole,
                               const std::string& where) {
  const json object = parse_json(text, where);
  if (!object.is_object()) fail_input("{}: {} is no JSON object", where, shown(text));
  StoredOcclusion stored;
  Occlusion& occlusion = stored.occlusion;
  occlusion.kind = occlusion_kind_from_name(shown(text_field(object, "of", where)), where);
  occlusion.mapping = {number_field(object, "threshold", where),
                       number_field(object, "weight", where)};
  validate(occlusion.mapping, where);
  // of all that was fitted, where this is a part
  occlusion.errors.texels =
      count_field(object, "texels", std::numeric_limits<std::size_t>::max(), where);
  occlusion.errors.wrong = count_field(object, "error_texels", occlusion.errors.texels, where);

  ModelInfo& info = stored.info;
  info.codec = text_field(object, "codec", where);
  const json& parameters = field(object, "parameters", where);
  if (!parameters.is_object()) fail_input("{}: \"parameters\" is no JSON object", where);
  info.parameters = parameters.dump();
  const std::string storage = text_field(object, "storage", where);
  if (storage != "f16" && storage != "f32") {
    fail_input("{}: storage \"{}\" is none of f16, f32", where, shown(storage));
  }
  info.storage = storage == "f16" ? Storage::f16 : Storage::f32;
  info.btf = occlusion_info(whole);
  return stored;
}

}  // namespace weft
