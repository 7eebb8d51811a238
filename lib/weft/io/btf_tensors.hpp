// What raw files and models say about a BTF in the same words: directions and mask as tensors, the
// rest as metadata.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/btf.hpp"
#include "weft/io/safetensors.hpp"

namespace weft {

// encoding, quantity, layout, channel_names (a JSON list), source.
void put_btf_metadata(const BtfInfo& info, Metadata& metadata);

// Fills these fields of `info` from a file. Where one is absent: sRGB for 8-bit data, linear for
// float data, radiance, grid, no names, no source. info.dtype is set.
void get_btf_metadata(const SafetensorsFile& file, BtfInfo& info);

// view_directions [V,3] and light_directions [L,3] (paired: [V,3]) as F32, mask [V,Y,X] as U8.
std::vector<TensorInfo> btf_side_tensors(const BtfInfo& info);
// The values of one of them.
std::span<const std::byte> btf_side_values(const BtfInfo& info, std::string_view tensor);

// Fills directions of `info` from a file and validates the whole. Shape, dtype and layout of `info`
// are set.
void get_directions(const SafetensorsFile& file, BtfInfo& info);
// Likewise the mask, if the file has one.
void get_mask(const SafetensorsFile& file, BtfInfo& info);
// Both.
void get_btf_side_tensors(const SafetensorsFile& file, BtfInfo& info);

// mask_distance [V,Y,X] as F32, which raw files may have beside the mask and models have not.
TensorInfo mask_distance_tensor(const BtfInfo& info);
// Fills it in from a file that has it, and checks it.
void get_mask_distance(const SafetensorsFile& file, BtfInfo& info);

// The version of our files in the metadata `weft.format`.
inline constexpr const char* file_format_version = "1";
// That of models with entropy-coded tensors.
inline constexpr const char* coded_format_version = "2";
// That of models with a packed mask, or a model of it.
inline constexpr const char* mask_format_version = "3";
// That of data bases of several materials.
inline constexpr const char* base_format_version = "4";
// Throws an input error for a file whose `weft.format` is none from the first to `newest`, the
// newest of its kind, naming them.
void check_format_version(const SafetensorsFile& file, std::string_view newest);

}  // namespace weft
