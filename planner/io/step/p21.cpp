// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/p21.hpp"

#include <algorithm>
#include <array>
#include <cstring>

#include "planner/io/step/p21_keywords.hpp"
#include "planner/io/step/p21_number.hpp"

namespace asbuilt::p21 {
namespace {

constexpr int kDepthLimit = 64;
constexpr std::size_t kListLimit = 10'000'000, kBytesLimit = std::size_t(4) << 30;
constexpr std::int64_t kIdLimit = std::int64_t(1) << 62;

enum : std::uint8_t { c_space = 1, c_digit = 2, c_name = 4 };
constexpr std::array<std::uint8_t, 256> make_classes() {
  std::array<std::uint8_t, 256> t{};
  for (const int c : {32, 9, 13, 10, 12, 11, 0}) t[c] = c_space;
  for (int c = '0'; c <= '9'; ++c) t[c] = c_digit | c_name;
  for (int c = 'A'; c <= 'Z'; ++c) t[c] = c_name;
  for (int c = 'a'; c <= 'z'; ++c) t[c] = c_name;
  t['_'] = t['-'] = c_name;
  return t;
}
constexpr auto kClass = make_classes();

class Parser {
 public:
  Parser(std::string_view bytes, File& file) : file_(file), begin_(bytes.data()), p_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  std::optional<Failure> run() {
    file_.bytes = {begin_, static_cast<std::size_t>(end_ - begin_)};
    if (file_.bytes.size() > kBytesLimit) return Failure{"step.limits", 1, "the file is larger than 4 GiB"};
    const std::size_t magic = file_.bytes.substr(0, 4096).find("ISO-10303-21");
    if (magic == std::string_view::npos)
      return Failure{"step.not_step", 1, "the first 4096 bytes hold no 'ISO-10303-21'; this is not a STEP file"};
    p_ = begin_ + magic + 12;
    const std::size_t guess = file_.bytes.size() / 50;
    file_.instances.reserve(guess), file_.records.reserve(guess), file_.values.reserve(file_.bytes.size() / 9);
    skip();
    if (p_ < end_ && *p_ == ';') ++p_;
    bool has_data = false, data_closed = true;
    for (;;) {
      skip();
      if (p_ >= end_) break;
      const std::string_view word = name();
      if (word.empty()) {
        fault(0, "unexpected byte between sections");
        ++p_;
        continue;
      }
      if (word == "HEADER" || word == "header") {
        header();
      } else if (word == "DATA" || word == "data") {
        skip();
        if (p_ < end_ && *p_ == '(')
          skip_to_semicolon();
        else if (p_ < end_ && *p_ == ';')
          ++p_;
        has_data = true;
        data_closed = data_section();
        if (!failure_ && !data_closed) return truncated("the file ends inside the DATA section: no ENDSEC and no END-ISO-10303-21");
      } else if (word == "END-ISO-10303-21") {
        file_.has_end = true;
        break;
      } else if (word == "ENDSEC") {
        skip_to_semicolon();
      } else {  // ANCHOR, REFERENCE, SIGNATURE or unknown
        skip_section();
      }
      if (failure_) return failure_;
    }
    if (failure_) return failure_;
    if (!has_data) return truncated("the file has no DATA section");
    file_.lines = line_;
    file_.extra = keywords_.extra();
    index_instances(file_);
    return std::nullopt;
  }

 private:
  Failure truncated(std::string what) const { return {"step.truncated", line_, std::move(what)}; }
  void fault(std::int64_t id, std::string what) {
    ++file_.faults_count;
    if (file_.faults.size() < 100) file_.faults.push_back({line_, id, std::move(what)});
  }

  void count_line() {  // LF, CR LF, or CR alone
    if (*p_ == '\n' || (*p_ == '\r' && (p_ + 1 >= end_ || p_[1] != '\n'))) ++line_;
  }
  void skip() {
    for (;;) {
      while (p_ < end_ && (kClass[static_cast<std::uint8_t>(*p_)] & c_space)) {
        count_line();
        ++p_;
      }
      if (p_ + 1 < end_ && *p_ == '/' && p_[1] == '*') {
        p_ += 2;
        while (p_ + 1 < end_ && !(*p_ == '*' && p_[1] == '/')) {
          count_line();
          ++p_;
        }
        p_ = std::min(p_ + 2, end_);
      } else {
        return;
      }
    }
  }
  std::string_view name() {
    const char* b = p_;
    if (p_ < end_ && *p_ == '!') ++p_;
    while (p_ < end_ && (kClass[static_cast<std::uint8_t>(*p_)] & c_name)) ++p_;
    return {b, static_cast<std::size_t>(p_ - b)};
  }
  void skip_string() {  // p_ on the opening quote
    ++p_;
    while (p_ < end_) {
      count_line();
      if (*p_ == '\'') {
        if (p_ + 1 < end_ && p_[1] == '\'') {
          p_ += 2;
          continue;
        }
        ++p_;
        return;
      }
      ++p_;
    }
  }
  void skip_to_semicolon() {
    while (p_ < end_) {
      skip();
      if (p_ >= end_) return;
      if (*p_ == '\'') {
        skip_string();
        continue;
      }
      if (*p_++ == ';') return;
    }
  }
  void skip_section() {
    while (p_ < end_) {
      skip();
      if (p_ >= end_) return;
      if (*p_ == '\'') {
        skip_string();
        continue;
      }
      if (kClass[static_cast<std::uint8_t>(*p_)] & c_name) {
        if (name() == "ENDSEC") {
          skip_to_semicolon();
          return;
        }
        continue;
      }
      ++p_;
    }
  }

  void header() {
    skip();
    if (p_ < end_ && *p_ == ';') ++p_;
    while (p_ < end_) {
      skip();
      const std::string_view word = name();
      if (word.empty()) {
        if (p_ < end_) ++p_;
        continue;
      }
      if (word == "ENDSEC") {
        skip_to_semicolon();
        return;
      }
      if (word == "DATA") {  // header never closed
        p_ -= 4;
        return;
      }
      int strings = 0;
      const bool is_schema = word == "FILE_SCHEMA", is_name = word == "FILE_NAME";
      while (p_ < end_) {
        skip();
        if (p_ >= end_) return;
        if (*p_ == '\'') {
          const char* b = p_ + 1;
          skip_string();
          const std::string_view raw(b, static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, p_ - b - 1)));
          if (is_schema && file_.schema.size() < 16) file_.schema.push_back(decoded(raw));
          if (is_name) {
            ++strings;
            file_.system = decoded(raw.substr(0, 200));
          }
          continue;
        }
        if (*p_++ == ';') break;
      }
    }
  }

  /// True when its ENDSEC (or END-ISO) was seen.
  bool data_section() {
    for (;;) {
      skip();
      if (p_ >= end_) return false;
      if (*p_ == '#') {
        instance();
        if (failure_) return true;
        continue;
      }
      if (kClass[static_cast<std::uint8_t>(*p_)] & c_name) {
        const char* b = p_;
        const std::string_view word = name();
        if (word == "ENDSEC") {
          skip_to_semicolon();
          return true;
        }
        if (word == "END-ISO-10303-21") {
          p_ = b;
          return true;
        }
        fault(0, "unexpected word in the DATA section");
        continue;
      }
      if (*p_ != ';') fault(0, "unexpected byte in the DATA section");
      ++p_;
    }
  }

  bool digits(std::int64_t& out) {
    const char* b = p_;
    std::int64_t v = 0;
    while (p_ < end_ && (kClass[static_cast<std::uint8_t>(*p_)] & c_digit)) {
      if (v > kIdLimit / 10 - 1) return false;
      v = 10 * v + (*p_++ - '0');
    }
    out = v;
    return p_ > b;
  }

  void instance() {
    const std::uint32_t line = line_;
    ++p_;
    std::int64_t id = 0;
    if (!digits(id)) {
      fault(0, "an instance without a usable id");
      return skip_to_semicolon();
    }
    skip();
    if (p_ >= end_ || *p_ != '=') {
      fault(id, "'=' is missing after the id");
      return skip_to_semicolon();
    }
    ++p_;
    skip();
    if (p_ < end_ && *p_ == '&') {  // &SCOPE .. ENDSCOPE
      skip_to_semicolon();
      return;
    }
    const std::size_t values_before = file_.values.size(), records_before = file_.records.size();
    bool ok = true;
    if (p_ < end_ && *p_ == '(') {
      ++p_;
      for (;;) {
        skip();
        if (p_ < end_ && *p_ == ')') {
          ++p_;
          break;
        }
        if (p_ >= end_ || !record()) {
          ok = false;
          break;
        }
        if (file_.records.size() - records_before > 1000) {
          fault_text_ = "more than 1000 parts in one complex instance";
          ok = false;
          break;
        }
      }
    } else {
      ok = record();
    }
    if (ok) {
      skip();
      if (p_ >= end_ || *p_ != ';') {
        ok = false;
        fault_text_ = "';' is missing at the end of the instance";
      } else {
        ++p_;
      }
    }
    if (!ok) {
      fault(id, fault_text_.empty() ? "broken parameter list" : fault_text_);
      fault_text_.clear();
      file_.values.resize(values_before), file_.records.resize(records_before);
      skip_to_semicolon();
      return;
    }
    if (file_.values.size() > 0xfffffff0u) {
      failure_ = Failure{"step.limits", line_, "more than 4e9 values"};
      return;
    }
    file_.instances.push_back(
        {id, line, static_cast<std::uint32_t>(records_before), static_cast<std::uint32_t>(file_.records.size() - records_before)});
  }

  bool record() {
    const std::string_view word = name();
    if (word.empty()) {
      fault_text_ = "an entity name is missing";
      return false;
    }
    Record r;
    r.keyword = keyword(word);
    skip();
    if (p_ >= end_ || *p_ != '(') {
      fault_text_ = "'(' is missing after the entity name";
      return false;
    }
    r.first = file_.values.size();
    if (!parameters(r.count)) return false;
    file_.records.push_back(r);
    return true;
  }
  std::uint32_t keyword(std::string_view word) {
    for (char c : word)
      if (c >= 'a' && c <= 'z') {  // rare: fold to upper case, keep the text alive in a side table
        std::string up(word);
        for (char& u : up)
          if (u >= 'a' && u <= 'z') u = static_cast<char>(u - 32);
        for (std::uint32_t k = 0; k < K_known_count; ++k)
          if (known_keyword(k) == up) return k;
        break;
      }
    return keywords_.id(word);
  }

  /// p_ on '('; reads to the matching ')'. Values go flat into the array; open lists are on a small stack.
  bool parameters(std::uint32_t& count) {
    struct Open {
      std::size_t at;  // index of the list value, or -1 for the outermost
      std::uint32_t elements;
      bool is_typed;
    };
    Open stack[kDepthLimit + 1];
    int depth = 0;
    stack[0] = {static_cast<std::size_t>(-1), 0, false};
    ++p_;
    auto& values = file_.values;
    bool expect_value = true;
    for (;;) {
      skip();
      if (p_ >= end_) {
        fault_text_ = "the file ends inside a parameter list";
        return false;
      }
      const char c = *p_;
      if (c == ')') {
        ++p_;
        if (depth == 0) {
          count = stack[0].elements;
          return true;
        }
        Value& v = values[stack[depth].at];
        v.size = stack[depth].elements;
        v.inside = values.size() - stack[depth].at - 1;
        if (stack[depth].is_typed) values[stack[depth].at - 1].inside = values.size() - stack[depth].at;
        --depth;
        expect_value = false;
        continue;
      }
      if (c == ',') {
        ++p_;
        expect_value = true;
        continue;
      }
      if (!expect_value) {
        fault_text_ = "',' or ')' expected";
        return false;
      }
      if (++stack[depth].elements > kListLimit) {
        fault_text_ = "a list with more than 1e7 elements";
        return false;
      }
      expect_value = false;
      values.emplace_back();
      Value& v = values.back();
      if (c == '#') {
        ++p_;
        v.kind = Kind::reference;
        if (!digits(v.integer)) {
          fault_text_ = "a reference without a usable id";
          return false;
        }
      } else if ((kClass[static_cast<std::uint8_t>(c)] & c_digit) || c == '-' || c == '+' || c == '.') {
        if (c == '.' && !(p_ + 1 < end_ && (kClass[static_cast<std::uint8_t>(p_[1])] & c_digit))) {
          const char* b = ++p_;
          while (p_ < end_ && *p_ != '.' && (kClass[static_cast<std::uint8_t>(*p_)] & c_name)) ++p_;
          if (p_ >= end_ || *p_ != '.') {
            fault_text_ = "an enumeration without its closing point";
            return false;
          }
          v.kind = Kind::enumeration;
          v.size = static_cast<std::uint32_t>(p_ - b);
          v.offset = static_cast<std::uint64_t>(b - begin_);
          ++p_;
        } else if (const char* wrong = read_number(p_, end_, v)) {
          fault_text_ = wrong;
          return false;
        }
      } else if (c == '\'') {
        const char* b = p_ + 1;
        skip_string();
        if (p_ >= end_) {
          fault_text_ = "the file ends inside a string";
          return false;
        }
        v.kind = Kind::string;
        v.size = static_cast<std::uint32_t>(p_ - b - 1);
        v.offset = static_cast<std::uint64_t>(b - begin_);
      } else if (c == '(') {
        ++p_;
        if (depth == kDepthLimit) {
          fault_text_ = "lists nested deeper than 64";
          return false;
        }
        v.kind = Kind::list;
        stack[++depth] = {values.size() - 1, 0, false};
        expect_value = true;
      } else if (c == '$') {
        ++p_;
      } else if (c == '*') {
        ++p_;
        v.kind = Kind::derived;
      } else if (c == '"') {
        const char* b = ++p_;
        while (p_ < end_ && *p_ != '"') ++p_;
        if (p_ >= end_) {
          fault_text_ = "the file ends inside a binary value";
          return false;
        }
        v.kind = Kind::binary;
        v.size = static_cast<std::uint32_t>(p_ - b);
        v.offset = static_cast<std::uint64_t>(b - begin_);
        ++p_;
      } else if ((kClass[static_cast<std::uint8_t>(c)] & c_name) || c == '!') {
        const std::string_view word = name();
        v.kind = Kind::typed;
        v.size = keyword(word);
        skip();
        if (p_ >= end_ || *p_ != '(' || depth == kDepthLimit) {
          fault_text_ = "'(' is missing after a type name";
          return false;
        }
        ++p_;
        values.emplace_back();
        values.back().kind = Kind::list;
        stack[++depth] = {values.size() - 1, 0, true};
        expect_value = true;
      } else {
        fault_text_ = "unexpected byte in a parameter list";
        return false;
      }
    }
  }

  File& file_;
  const char *begin_, *p_, *end_;
  std::uint32_t line_ = 1;
  std::string fault_text_;
  std::optional<Failure> failure_;
  Keywords keywords_;
};

}  // namespace

std::optional<Failure> parse(std::string_view bytes, File& file) { return Parser(bytes, file).run(); }

}  // namespace asbuilt::p21
