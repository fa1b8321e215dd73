// SPDX-License-Identifier: GPL-3.0-or-later
// Modules, their heads and comments, the .dat file, declarations and aggregates.
#include "postprocessors/krl/reader.hpp"

namespace asbuilt::krl {

void Reader::load(const ProgramFile& f) {
  const auto ends = [&](std::string_view e) {
    std::string low = f.name;
    for (char& c : low) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
    return low.ends_with(e);
  };
  if (ends(".dat")) return load_data(f);
  if (ends(".cell.txt")) return;  // for the integrator, never loaded
  if (!ends(".src")) fail({&f.name, 0, {}}, "read.file", "a KRL program consists of .src and .dat files");
  Module* open = nullptr;
  bool has_code = false;
  for (const Line& line : lines_of(f)) {
    Scanner s(line, code(line.text));
    if (line.text.starts_with("&")) {
      if (open || has_code) fail(line, "read.unknown", "a line with & belongs at the top of the file");
      continue;
    }
    if (s.at_end()) {
      if (!open) continue;
      const std::size_t at = line.text.find(';');
      if (open->body.empty() && at != std::string_view::npos && !is_comment_fold(line.text.substr(at + 1))) {
        std::string_view h = line.text.substr(at + 1);
        h.remove_prefix(std::min(h.find_first_not_of(' '), h.size()));
        h.remove_suffix(h.size() - std::min(h.size(), h.find_last_not_of(' ') + 1));
        open->header.emplace_back(h);
      } else if (at != std::string_view::npos) {
        open->body.push_back(line);
      }
      continue;
    }
    has_code = true;
    Scanner d(line, code(line.text));
    d.accept("GLOBAL");
    if (d.accept("DEF")) {
      if (open) fail(line, "read.unknown", "a DEF inside another one; END is missing");
      const std::string_view before = d.rest();
      Module m;
      m.head = line;
      m.name = d.name();
      if (m.name.empty()) d.unknown();
      if (order_.empty()) original_name_ = std::string(before.substr(0, m.name.size()));
      d.expect("("), d.expect(")"), d.expect_end();
      if (modules_.count(m.name)) fail(line, "read.name", m.name + " is defined twice");
      order_.push_back(m.name);
      open = &modules_[m.name];
      *open = std::move(m);
      continue;
    }
    if (!open) s.unknown();
    if (s.accept("END")) {
      s.expect_end();
      open->body.push_back(line);
      open = nullptr;
      continue;
    }
    open->body.push_back(line);
  }
  if (open) fail(open->head, "read.missing", "END is missing");
}

void Reader::load_data(const ProgramFile& f) {
  int state = 0;  // 0: before DEFDAT, 1: inside, 2: after ENDDAT
  for (const Line& line : lines_of(f)) {
    Scanner s(line, code(line.text));
    if (line.text.starts_with("&")) {
      if (state != 0) fail(line, "read.unknown", "a line with & belongs at the top of the file");
      continue;
    }
    if (s.at_end()) continue;
    if (state == 0) {
      s.expect("DEFDAT");
      if (s.name().empty()) s.unknown();
      s.accept("PUBLIC"), s.expect_end();
      state = 1;
    } else if (state == 1 && s.accept("ENDDAT")) {
      s.expect_end(), state = 2;
    } else if (state == 1) {
      if (s.accept("EXT")) continue;  // the head of a sub-program elsewhere
      if (!declaration(s)) s.unknown();
    } else {
      s.unknown();
    }
  }
  if (state != 2) fail({&f.name, 0, {}}, "read.missing", "DEFDAT or ENDDAT is missing");
}

bool Reader::declaration(Scanner& s) {
  static const std::set<std::string> with_value = {"E6POS", "POS", "FRAME", "E6AXIS", "AXIS", "FDAT"};
  static const std::set<std::string> ignored = {"LDAT", "PDAT", "LOAD", "INT", "REAL", "BOOL", "CHAR", "BASIS_SUGG_T"};
  Scanner t = s;
  t.accept("GLOBAL");
  const bool is_decl = t.accept("DECL");
  t.accept("GLOBAL");
  const std::string type = t.name();
  const bool is_simple = type == "INT" || type == "REAL" || type == "BOOL" || type == "CHAR";
  if (!is_decl && !is_simple && !with_value.count(type)) return false;
  s = t;
  if (ignored.count(type)) {
    if (s.name().empty()) s.unknown();
    return true;
  }
  if (!with_value.count(type)) fail(s.line(), "read.unknown", "a declaration of type " + type + " is not read");
  do {
    const std::string name = s.name();
    if (name.empty()) s.unknown();
    if (s.accept("=")) {
      if (names_.count(name)) fail(s.line(), "read.name", name + " is declared twice");
      names_[name] = aggregate(s);
    } else {
      declared_.insert(name);
    }
  } while (s.accept(","));
  s.expect_end();
  return true;
}

Components Reader::aggregate(Scanner& s) {
  static const std::set<std::string> numeric = {"X",  "Y",  "Z",  "A",  "B",  "C",  "S",  "T",  "A1", "A2",      "A3",      "A4", "A5",
                                                "A6", "E1", "E2", "E3", "E4", "E5", "E6", "CP", "ORI1", "ORI2", "TOOL_NO", "BASE_NO"};
  Components out;
  s.expect("{");
  for (bool first = true; !s.accept("}"); first = false) {
    if (!first) s.expect(",");
    std::string key = s.name();
    if (first && s.accept(":")) key = s.name();  // {E6POS: X ...
    if (numeric.count(key)) {
      if (!out.emplace(key, s.expect_number("a number")).second) fail(s.line(), "read.name", key + " is given twice");
    } else if (key == "IPO_FRAME") {
      s.expect("#BASE");
    } else if (key == "POINT2") {
      s.expect("["), s.expect("]"), s.expect("\"");
      while (!s.accept("\""))
        if (s.name().empty()) s.unknown();
    } else {
      s.unknown();
    }
  }
  return out;
}

}  // namespace asbuilt::krl
