// SPDX-License-Identifier: GPL-3.0-or-later
// ISO 10303-21 text -> table of instances. Knows the syntax, no schema. One pass, no recursion, parameters in one flat array.
// A fault inside one instance is recorded with its line and the reader goes on after the next ';'.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/io/step/keywords.hpp"

namespace asbuilt::p21 {

enum class Kind : std::uint8_t { null, derived, integer, real, reference, enumeration, string, list, typed, binary };

/// 16 bytes. list: size = direct elements, inside = all values that follow and belong to it. typed: keyword, inside = its list.
struct Value {
  Kind kind = Kind::null;
  std::uint32_t size = 0;  // list: elements; string, enumeration, binary: bytes; typed: keyword
  union {
    double real;
    std::int64_t integer;  // also the id of a reference
    std::uint64_t offset;  // of the text in the file
    std::uint64_t inside;
  };
  Value() : integer(0) {}
};
static_assert(sizeof(Value) == 16);

inline const Value* next(const Value* v) { return v + 1 + (v->kind == Kind::list || v->kind == Kind::typed ? v->inside : 0); }

struct Record {  // one keyword with its parameters
  std::uint32_t keyword = 0;
  std::uint32_t count = 0;  // parameters
  std::uint64_t first = 0;  // index of the first parameter in File::values
};

struct Instance {
  std::int64_t id = 0;
  std::uint32_t line = 0;
  std::uint32_t record = 0, record_count = 0;  // more than one: complex instance
};

struct Fault {
  std::uint32_t line = 0;
  std::int64_t id = 0;  // 0: none
  std::string what;
};

struct File {
  std::string_view bytes;
  std::vector<Value> values;
  std::vector<Record> records;
  std::vector<Instance> instances;      // in file order
  std::vector<std::string_view> extra;  // keywords past the known ones
  std::vector<Fault> faults;            // first 100
  std::size_t faults_count = 0;
  std::vector<std::string> schema;  // FILE_SCHEMA
  std::string system;               // originating system of FILE_NAME
  std::uint32_t lines = 0;
  bool has_end = false;  // ENDSEC of a DATA section and END-ISO-10303-21 seen

  /// The instance with this id, or null.
  const Instance* find(std::int64_t id) const;
  std::string_view keyword_name(std::uint32_t keyword) const;

  std::vector<std::int32_t> dense;                            // id -> index, -1 none
  std::vector<std::pair<std::int64_t, std::int32_t>> sparse;  // sorted, when ids are far apart
};

/// What cannot be read at all.
struct Failure {
  std::string code;  // step.not_step, step.truncated, step.limits
  std::uint32_t line = 0;
  std::string what;
};
std::optional<Failure> parse(std::string_view bytes, File& file);
/// Fills File::dense or File::sparse; of an id used twice the first instance counts, and the others are faults.
void index_instances(File& file);

/// The text of a string value: directives and doubled quotes decoded to UTF-8; unknown directives stay as they are.
std::string decoded(std::string_view raw);

}  // namespace asbuilt::p21
