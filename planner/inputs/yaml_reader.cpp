// SPDX-License-Identifier: GPL-3.0-or-later
// The mapping reader: keys, what is missing, what is unknown, choices between keys.
#include "planner/inputs/yaml_reader.hpp"

#include <algorithm>

#include "planner/io/file.hpp"

namespace asbuilt::inputs {

namespace {

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
      diagonal = above;
    }
  }
  return row[b.size()];
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& w : words) text += (text.empty() ? "" : ", ") + w;
  return text;
}

constexpr std::size_t kNodesLimit = 5'000'000;
constexpr std::size_t kBytesLimit = 64u << 20;

}  // namespace

std::string Readout::where(const std::string& field) const {
  std::string parent = field;
  int line = 0;
  while (true) {
    const auto it = lines.find(parent);
    if (it != lines.end()) {
      line = it->second;
      break;
    }
    const std::size_t cut = parent.find_last_of(".[");
    if (cut == std::string::npos) {
      if (parent.empty()) break;
      parent.clear();
    } else {
      parent.resize(cut);
    }
  }
  return name + (line ? ":" + std::to_string(line) : "") + (field.empty() ? "" : ": " + field);
}

void Readout::fault(std::string code, const std::string& field, std::string message) {
  fault(std::move(code), field, std::move(message), 0, 0, "");
}
void Readout::fault(std::string code, const std::string& field, std::string message, double measured, double limit, std::string unit) {
  if (faults.size() >= 1000) return;  // a file of another kind altogether need not be listed to its end
  faults.push_back({.code = std::move(code),
                    .where = where(field),
                    .message = std::move(message),
                    .measured = measured,
                    .limit = limit,
                    .unit = std::move(unit),
                    .stage = "input"});
}

MapReader::MapReader(Readout& out, const YAML::Node& node, std::string field) : out_(out), node_(node), field_(std::move(field)) {
  for (const auto& entry : node_) {
    if (++out_.nodes_count > kNodesLimit) {
      out_.fault("input.too_large", field_, "the file stands for too many values");
      return;
    }
    if (!entry.first.IsScalar()) {
      out_.fault("input.wrong_type", field_, "found a key that is no name, allowed names");
      continue;
    }
    const std::string key = entry.first.Scalar();
    if (values_.count(key)) {
      out_.lines[child(key)] = entry.first.Mark().line + 1;
      out_.fault("input.duplicate_key", child(key),
                 "found the key '" + shown(key) + "' twice (first on line " + std::to_string(key_line_[key]) + "), allowed once");
      continue;
    }
    values_[key] = entry.second;
    key_line_[key] = entry.first.Mark().line + 1;
    order_.push_back(key);
  }
}

const YAML::Node* MapReader::take(const std::string& name) {
  asked_.push_back(name);
  const auto it = values_.find(name);
  if (it == values_.end()) return nullptr;
  taken_.insert(name);
  return &it->second;
}

bool MapReader::has(const char* name) const { return values_.count(name) > 0; }

bool MapReader::is_required(const Field& f) const {
  if (f.when_key.empty()) return !f.is_optional;
  const auto it = values_.find(std::string(f.when_key));
  if (it == values_.end() || !it->second.IsScalar()) return false;
  const std::string padded = "|" + std::string(f.when_values) + "|";
  return padded.find("|" + it->second.Scalar() + "|") != std::string::npos;
}

void MapReader::missing(const char* name, bool has_key, const Field& f) {
  out_.fault("input.missing_key", child(name),
             std::string(has_key ? "found no value" : "found nothing") + ", allowed: " + std::string(f.doc.empty() ? "a value" : f.doc) +
                 (f.unit.empty() ? "" : " (" + std::string(f.unit) + ")"));
}

void MapReader::exactly_one(std::initializer_list<const char*> names) {
  std::vector<std::string> found, all;
  for (const char* n : names) {
    all.push_back(n);
    if (has(n)) found.push_back(n);
  }
  if (found.size() == 1) return;
  out_.fault("input.choose_one", field_, "found " + (found.empty() ? "none" : joined(found)) + ", allowed exactly one of " + joined(all));
}

void MapReader::together(const char* name, std::initializer_list<const char*> others) {
  if (!has(name)) return;
  for (const char* o : others)
    if (!has(o)) out_.fault("input.missing_key", child(o), "found nothing, required together with '" + std::string(name) + "'");
}

void MapReader::rest(std::map<std::string, std::string>& values, const char*) {
  for (const std::string& key : order_) {
    if (taken_.count(key)) continue;
    const YAML::Node& node = values_[key];
    const bool is_slip = std::any_of(asked_.begin(), asked_.end(), [&](const std::string& a) { return edit_distance(a, key) <= 2; });
    if (!node.IsScalar() || is_slip) continue;  // finish() names it
    taken_.insert(key);
    mark(out_, node, child(key));
    values[key] = node.Scalar();
  }
}

void MapReader::finish() {
  for (const std::string& key : order_) {
    if (taken_.count(key)) continue;
    std::string nearest;
    std::size_t best = 3;
    for (const std::string& a : asked_)
      if (const std::size_t d = edit_distance(a, key); d < best) best = d, nearest = a;
    std::vector<std::string> free;
    for (const std::string& a : asked_)
      if (!taken_.count(a)) free.push_back(a);
    out_.lines[child(key)] = key_line_[key];
    out_.fault("input.unknown_key", child(shown(key)),
               "found the key '" + shown(key) + "', " +
                   (nearest.empty() ? (free.empty() ? std::string("no further key is allowed here") : "allowed here: " + joined(free))
                                    : "did you mean '" + nearest + "'?"));
  }
}

bool MapReader::header(std::string_view kind) {
  const std::string want = std::string(kind) + "/1";
  const YAML::Node* node = take("asbuilt");
  if (!node || !node->IsScalar()) {
    out_.fault("input.missing_header", "asbuilt",
               "found no 'asbuilt:' line that says what kind of file this is, allowed 'asbuilt: " + want + "'");
    return false;
  }
  mark(out_, *node, "asbuilt");
  const std::string found = node->Scalar();
  if (found == want) return out_.is_of_kind = true;
  const std::size_t slash = found.find('/');
  if (slash != std::string::npos && found.substr(0, slash) == kind)
    out_.fault("input.version_unknown", "asbuilt",
               "found '" + shown(found) + "', allowed '" + want + "': this program reads version 1 only");
  else out_.fault("input.wrong_kind", "asbuilt", "found '" + shown(found) + "', allowed '" + want + "'");
  return false;
}

std::optional<YAML::Node> parse_yaml(std::string_view text, Readout& out) {
  if (text.size() > kBytesLimit) {
    out.fault("input.too_large", "", "found " + std::to_string(text.size() >> 20) + " MiB, allowed 64 MiB of YAML",
              double(text.size() >> 20), 64, "MiB");
    return std::nullopt;
  }
  if (const std::optional<std::size_t> bad = first_not_utf8(text)) {
    const int line = 1 + int(std::count(text.begin(), text.begin() + std::ptrdiff_t(*bad), '\n'));
    out.lines[""] = line;
    out.fault("input.not_text", "", "found a byte that is no UTF-8 text, allowed UTF-8 without control characters");
    return std::nullopt;
  }
  if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(std::string(text));
    if (documents.size() != 1) {
      out.lines[""] = 1;
      out.fault("input.yaml_syntax", "", "found " + std::to_string(documents.size()) + " documents, allowed one");
      return std::nullopt;
    }
    out.lines[""] = documents[0].Mark().line + 1;
    return documents[0];
  } catch (const YAML::Exception& e) {
    out.lines[""] = e.mark.is_null() ? 1 : e.mark.line + 1;
    out.fault(
        "input.yaml_syntax", "",
        "found text that is no YAML (" + shown(e.msg) + " at column " + std::to_string(e.mark.is_null() ? 1 : e.mark.column + 1) + ")");
  } catch (const std::exception& e) {
    out.lines[""] = 1;
    out.fault("input.yaml_syntax", "", "found text that is no YAML (" + shown(e.what()) + ")");
  }
  return std::nullopt;
}

}  // namespace asbuilt::inputs
