// SPDX-License-Identifier: GPL-3.0-or-later
// The files of one item: where a path leads, who may leave the root, and the hash of everything that was read.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "planner/inputs/yaml_reader.hpp"
#include "planner/io/file.hpp"

namespace asbuilt::inputs {

class Sources {
 public:
  Sources(const std::filesystem::path& root, bool allow_outside);

  /// The file that `text` names in the file `naming_file` at `field`. Faults input.path_outside.
  std::optional<std::filesystem::path> resolve(Readout& naming, const std::string& field, const std::filesystem::path& naming_file,
                                               const std::string& text) const;
  /// Its bytes; the file joins the list of inputs. Faults input.file_missing, input.file_unreadable at the naming field.
  std::optional<std::string> read(Readout& naming, const std::string& field, const std::filesystem::path& file);
  /// As people are shown it: relative to the root.
  std::string name_of(const std::filesystem::path& file) const;
  /// Everything read so far, sorted by path.
  std::vector<InputFile> files() const;

 private:
  std::filesystem::path root_;
  bool allow_outside_;
  std::map<std::string, std::string> hashes_;
};

/// One YAML file with what it says and where.
template <class T>
struct YamlSource {
  std::filesystem::path file;
  Readout out;
  T value;
  bool is_read = false;  // the file is there and is of its kind; single fields may be faulty
};

template <class T>
YamlSource<T> read_source(Sources& sources, Readout& naming, const std::string& field, const std::filesystem::path& naming_file,
                          const std::string& text) {
  YamlSource<T> s;
  if (text.empty()) return s;  // its own fault is written down already
  const auto file = sources.resolve(naming, field, naming_file, text);
  if (!file) return s;
  s.file = *file;
  s.out.name = sources.name_of(*file);
  const auto bytes = sources.read(naming, field, *file);
  if (!bytes) return s;
  s.value = read_yaml<T>(*bytes, s.out);
  s.is_read = s.out.is_of_kind;
  return s;
}

}  // namespace asbuilt::inputs
