// A valid model file taken apart, changed and put together again with the right checksums, so that
// a test reaches the checks behind them.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "io/file_bytes.hpp"
#include "weft/model/model_metadata.hpp"

namespace weft::test {

struct EditableModel {
  nlohmann::json header;
  std::string data;

  explicit EditableModel(const std::string& file) {
    std::size_t length = 0;
    for (std::size_t i = 8; i-- > 0;) length = length << 8 | static_cast<unsigned char>(file[i]);
    header = nlohmann::json::parse(file.substr(8, length));
    data = file.substr(8 + length);
  }

  nlohmann::json& metadata() { return header["__metadata__"]; }

  // Where a tensor's bytes begin in `data`.
  std::size_t begin(const std::string& tensor) const {
    return header[tensor]["data_offsets"][0].get<std::size_t>();
  }
  std::string bytes_of(const std::string& tensor) const {
    const std::size_t end = header[tensor]["data_offsets"][1].get<std::size_t>();
    return data.substr(begin(tensor), end - begin(tensor));
  }

  // Puts a new tensor behind the others.
  void append(const std::string& tensor, const std::string& dtype,
              const std::vector<std::size_t>& shape, const std::string& bytes) {
    header[tensor] = {{"dtype", dtype},
                      {"shape", shape},
                      {"data_offsets", {data.size(), data.size() + bytes.size()}}};
    data += bytes;
  }
  void rename(const std::string& tensor, const std::string& name) {
    header[name] = header[tensor];
    header.erase(tensor);
  }

  void set_checksums() {
    nlohmann::json checksums = nlohmann::json::object();
    for (const auto& [name, tensor] : header.items()) {
      if (name != "__metadata__") {
        const std::string bytes = bytes_of(name);
        checksums[name] = checksum_of(std::as_bytes(std::span(bytes)));
      }
    }
    metadata()["checksums"] = checksums.dump();
  }

  std::string file() const { return container(header.dump(), data); }
};

}  // namespace weft::test
