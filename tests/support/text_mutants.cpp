// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/text_mutants.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace asbuilt::support {

namespace {
bool is_word(char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '$' || c == '.' || c == '-'; }

}  // namespace

std::vector<TextToken> tokens_of(const ProgramText& text) {
  std::vector<TextToken> out;
  for (std::size_t f = 0; f < text.files.size(); ++f) {
    const std::string& s = text.files[f].bytes;
    for (std::size_t i = 0; i < s.size();) {
      if (s[i] == ' ' || s[i] == '\r') {
        ++i;
        continue;
      }
      std::size_t j = i + 1;
      if (is_word(s[i]))
        while (j < s.size() && is_word(s[j])) ++j;
      out.push_back({f, i, j});
      i = j;
    }
  }
  return out;
}

std::string line_around(const std::string& s, std::size_t at) {
  const std::size_t a = at == 0 ? 0 : s.rfind('\n', at - 1) + 1, b = s.find('\n', at);
  std::string line = s.substr(a, (b == std::string::npos ? s.size() : b) - a);
  while (!line.empty() && (line.back() == '\r' || line.back() == '\n')) line.pop_back();
  return line;
}

/// Why a change that nothing objected to does nothing; empty where it is not known to be harmless.
std::string harmless(Language language, const std::string& line, const std::string& token, const std::string& changed) {
  const auto has = [&](std::string_view t) { return line.find(t) != std::string::npos; };
  std::string lead = line.substr(std::min(line.size(), line.find_first_not_of(' ')));
  if (changed == token + " " + token || changed.empty()) {
    if (token == "\n" && (has(";"))) return "a blank line, or none, beside a remark";
  }
  const auto capitals = [](std::string t) {
    for (char& c : t) c = static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
    return t;
  };
  if (language == Language::krl && capitals(token) == capitals(changed)) return "another letter case, which KRL does not tell apart";
  const bool is_fold = lead.starts_with(";FOLD") || lead.starts_with(";ENDFOLD");
  if (!is_fold && (lead.starts_with(";") || lead.starts_with("'") || lead.starts_with("(") || lead.starts_with("#")) && language != Language::beckhoff) return "the text of a remark";
  if (language == Language::beckhoff && lead.starts_with(";")) return "the text of a remark";
  if (has("CR=") || token == "G261" || token == "C_DIS") return "a corner that is rounded less than planned";
  if (token[0] == 'F' && has(" G01 X") && changed[0] == 'F' && std::abs(std::atof(token.c_str() + 1) - std::atof(changed.c_str() + 1)) < 0.005 * std::atof(token.c_str() + 1) && !has("G26") && !has("M4"))
    return "a speed changed by less than its tolerance";
  if (language == Language::krl) {
    if (lead.starts_with(";FOLD") || lead.starts_with(";ENDFOLD")) return "what a fold is called on the pendant";
    if (lead.starts_with("&")) return "a line the controller rewrites";
    if (has("PRIO=")) return "another priority that is free";
    if (token == "DECL" && has("FRAME")) return "DECL, which may be left out before a type that KRL knows";
    if (token[0] >= '0' && token[0] <= '9' && changed[0] >= '0' && changed[0] <= '9' && std::atof(token.c_str()) == std::atof(changed.c_str())) return "a number written with other decimals";
    if (has("$ADVANCE")) return "advance within its range";
    if (has("$ORI_TYPE")) return "another orientation rule: replayed under every rule";
    if (has("WAIT FOR")) return "a check of the machine's data that holds all the same";
    if (has("$APO.CDIS") || has("$VEL.CP") || has("BAS (#VEL_PTP")) return "a setting that is set again before it is used, or twice the same";
    if (has("$IPO_MODE") || has("$CIRC_TYPE") || has("INTERRUPT") || has("$TOOL") || has("$BASE") || has("$ANOUT")) return "the same statement twice";
    if (has("DELAY=0") && token == "0") return "zero written another way";
    if (has("EXPECTED_TOOL")) return "within the tolerance of the check on the machine";
    if (token == "\n") return "an empty line";
  }
  if (language == Language::inform) {
    if (has("///DATE")) return "the time of day, or a date the rules warn of";
    if (has("///NAME")) return "what a frame is called on the pendant";
    if (has("///ATTR")) return "an attribute of the pendant";
    if (has("///RCONF")) return "a flag of the posture: the arm stands in it already when the path begins";
    if (has("AOUT")) return "the same statement twice";
    if (has("CR=") && token.find("CR") != std::string::npos) return "";
    if (has("///TOOL") || has("///POSTYPE") || has("///PULSE") || has("///RECTAN") || has("///GROUP1") || has("///NPOS")) return "the same statement twice";
  }
  if (language == Language::ur) {
    if (has("set_tcp")) return "within what the cell's tool may differ by, or the same tool twice";
    if (has("analog")) return "the same statement twice";
    if (has(" a=")) return "an acceleration within its range";
    if (has("movej")) return "a joint speed changed by less than its tolerance";
    if (token == "\n") return "an empty line";
  }
  if (language == Language::nci) {
    if (has(" T") || has("M05") || has("M03") || has(" M")) return "a state that is set already";
    if ((token[0] == 'I' || token[0] == 'J' || token[0] == 'K') && !changed.empty()) return "a centre within a micrometre";
    if (token[0] == 'F' && has("G01") && !changed.empty() && std::abs(std::atof(token.c_str() + 1) - std::atof(changed.c_str() + 1)) < 0.05)
      return "a joint speed changed by less than its tolerance";
    if (token[0] == 'N') return "a block number that still rises, or none";
    if (token.starts_with("G01") || token.starts_with("G17") || token.starts_with("G03") || token.starts_with("G02")) return "the word is in force already";
    if (token == "\n") return "an empty line";
  }
  if ((language == Language::beckhoff || language == Language::nci) && token[0] == 'F' && changed[0] != 'F') return "the feed is in force already";
  if (language == Language::beckhoff) {
    if (has("#CONTOUR") || has("#CS") || has("#TRAFO") || has("#KIN") || has(" T") || has("M05") || has("G94") || has("M03")) return "a state that is set already";
    if (lead.starts_with("N")) {
      if (token == "G260" && changed == "G060") return "an exact stop all the same";
      if ((token[0] == 'I' || token[0] == 'J' || token[0] == 'K') && !changed.empty()) return "a centre within a micrometre";
      if (token[0] == 'F' && has("G01") && !changed.empty() && std::abs(std::atof(token.c_str() + 1) - std::atof(changed.c_str() + 1)) < 0.05)
        return "a joint speed changed by less than its tolerance";
      if (token[0] == 'N') return "a block number that still rises, or none";
      if (token.starts_with("G01") || token.starts_with("G17") || token.starts_with("G03") || token.starts_with("G02")) return "the word is in force already";
    }
    if (token == "\n") return "an empty line";
  }
  if (std::abs(std::atof(token.c_str())) == 180 && std::atof(token.c_str()) == -std::atof(changed.c_str())) return "half a turn, the one way or the other";
  if (language == Language::beckhoff && lead.starts_with("%")) return "the name of the program";
  const std::size_t x_word = line.find(" X");  // axis values have four decimals
  const bool is_joint_block = x_word != std::string::npos && line.find('.', x_word) != std::string::npos && line.substr(line.find('.', x_word) + 1, 5).find_first_not_of("0123456789") == 4;
  if (token[0] == 'F' && changed[0] == 'F' && is_joint_block && std::abs(std::atof(token.c_str() + 1) - std::atof(changed.c_str() + 1)) < 36) return "a joint speed changed by less than its tolerance";
  const std::size_t digits = static_cast<std::size_t>(std::count_if(token.begin(), token.end(), [](char c) { return c >= '0' && c <= '9'; }));
  const auto value = [](const std::string& s) { return std::atof(s.c_str() + (!s.empty() && s[0] >= 'A' ? 1 : 0)); };
  if (digits > 0 && token.size() == changed.size() && std::abs(value(token) - value(changed)) < 2.1e-4) return "an angle changed by no more than its tolerance";
  if (digits > 0 && token.size() == changed.size() && std::abs(value(token) - value(changed)) < 0.00101) return "a coordinate changed by its last digit, no farther from the plan than rounding may be";
  if (language == Language::inform && line.starts_with("C0") && token.find('.') == std::string::npos && std::abs(value(token) - value(changed)) < 1.5) return "a joint changed by a pulse, no farther from the plan than rounding may be";
  return "";
}

std::vector<std::string> changes_of(const std::string& token, Random& random) {
  std::vector<std::string> changes = {"", token + " " + token};
  std::string digit = token;  // one digit becomes another
  std::vector<std::size_t> digits;
  for (std::size_t i = 0; i < digit.size(); ++i)
    if (digit[i] >= '0' && digit[i] <= '9') digits.push_back(i);
  if (!digits.empty()) {
    char& c = digit[digits[random.below(digits.size())]];
    c = static_cast<char>('0' + (c - '0' + 1 + random.below(9)) % 10);
    changes.push_back(digit);
  }
  if (token[0] == '-') changes.push_back(token.substr(1));
  if (token[0] >= '0' && token[0] <= '9') changes.push_back("-" + token);
  if (digits.empty() && token != "\n") {
    std::string other = token;
    other[random.below(other.size())] = "AEIXZ79_=,+"[random.below(11)];
    if (other != token) changes.push_back(other);
  }
  return changes;
}

std::vector<std::string> every_change_of(const std::string& token, const std::vector<std::string>& pool, Random& random) {
  std::vector<std::string> out = changes_of(token, random);
  std::vector<std::size_t> digits;
  for (std::size_t i = 0; i < token.size(); ++i)
    if (token[i] >= '0' && token[i] <= '9') digits.push_back(i);
  const auto step = [&](std::size_t i, int by) {
    std::string s = token;
    s[i] = static_cast<char>('0' + (s[i] - '0' + 10 + by) % 10);
    out.push_back(s);
  };
  if (!digits.empty()) step(digits.back(), 1), step(digits.back(), -1), step(digits.front(), 1);
  if (const std::size_t dot = token.find('.'); dot != std::string::npos && dot > 0 && dot + 1 < token.size()) {
    std::string up = token, down = token;
    std::swap(up[dot], up[dot + 1]), std::swap(down[dot], down[dot - 1]);
    out.push_back(up), out.push_back(down);
  }
  if (token[0] >= 'A' && token[0] <= 'Z' && token.size() > 1) {  // a word with its number: X-37.914
    std::string s = token;
    if (s[1] == '-') s.erase(1, 1);
    else if (s[1] >= '0' && s[1] <= '9') s = s.substr(0, 1) + "-" + s.substr(1);
    out.push_back(s);
  }
  // other tokens of the program: of the same kind, and any
  const auto kind = [](const std::string& t) { return t[0] >= '0' && t[0] <= '9' ? 0 : t[0] == '-' ? 0 : is_word(t[0]) ? 1 : 2; };
  for (int k = 0, taken = 0; k < 40 && taken < 3; ++k) {
    const std::string& other = pool[random.below(pool.size())];
    if (other == token || other == "\n" || (taken < 2 && kind(other) != kind(token))) continue;
    out.push_back(other), ++taken;
  }
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  out.erase(std::remove(out.begin(), out.end(), token), out.end());
  return out;
}

}  // namespace asbuilt::support
