// The bytes of the files of several models of one source, without writing them: what entropy coding
// makes of the mask that they share, or of its model, is found once.
#pragma once

#include <cstddef>
#include <memory>

#include "weft/model/model.hpp"

namespace weft {

// The longest that the errors of a model may be in its file.
ErrorReport longest_errors(bool weighted);

class FileSizer {
 public:
  FileSizer();
  ~FileSizer();
  FileSizer(const FileSizer&) = delete;
  FileSizer& operator=(const FileSizer&) = delete;

  // The same as model_file_size.
  std::size_t size(const Model& model);
  // Of a model whose errors are not measured yet: with the longest that they may be.
  std::size_t size_with_errors(Model& model);
  // How many masks and models of masks were coded.
  std::size_t coded_masks() const;

 private:
  struct Masks;
  std::unique_ptr<Masks> masks_;
};

}  // namespace weft
