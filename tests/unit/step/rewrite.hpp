// SPDX-License-Identifier: GPL-3.0-or-later
// Any STEP file written another way that means the same part: other ids, orders, line ends, comments, units, senses, wrappers, places.
// Works on the text alone and knows nothing of the reader.
#pragma once

#include <algorithm>
#include <cctype>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/number.hpp"
#include "planner/base/random.hpp"

namespace asbuilt::test {

/// The file as what stands before the first instance, the instances, and what stands after the last one.
struct StepParts {
  struct Instance {
    long long id = 0;
    std::string body;  // after the equals sign, without comments and the semicolon
  };
  std::string before, after;
  std::vector<Instance> all;
  std::map<long long, std::size_t> at;  // id -> position

  std::string text() const {
    std::string s = before;
    for (const Instance& i : all) s += "#" + std::to_string(i.id) + "=" + i.body + ";\n";
    return s + after;
  }
  Instance* find(long long id) {
    const auto it = at.find(id);
    return it == at.end() ? nullptr : &all[it->second];
  }
  long long last_id() const { return at.empty() ? 0 : at.rbegin()->first; }
  long long add(const std::string& body) {
    const long long id = last_id() + 1;
    at[id] = all.size();
    all.push_back({id, body});
    return id;
  }
};

inline StepParts parts_of(const std::string& text) {
  StepParts out;
  std::string plain;  // without comments
  for (std::size_t k = 0; k < text.size();) {
    if (text[k] == '\'') {
      const std::size_t end = text.find('\'', k + 1), to = end == std::string::npos ? text.size() : end + 1;
      plain.append(text, k, to - k), k = to;
    } else if (text.compare(k, 2, "/*") == 0) {
      const std::size_t end = text.find("*/", k + 2);
      k = end == std::string::npos ? text.size() : end + 2, plain += ' ';
    } else {
      plain += text[k++];
    }
  }
  std::size_t data = plain.find("DATA");
  while (data != std::string::npos && plain.find_first_not_of(" \t\r\n", data + 4) != std::string::npos &&
         plain[plain.find_first_not_of(" \t\r\n", data + 4)] != ';')
    data = plain.find("DATA", data + 4);
  if (data == std::string::npos) return out;
  std::size_t k = plain.find(';', data) + 1;
  out.before = plain.substr(0, k) + "\n";
  while (true) {
    const std::size_t begin = plain.find_first_not_of(" \t\r\n", k);
    if (begin == std::string::npos) break;
    if (plain[begin] != '#') {
      out.after = plain.substr(begin);
      break;
    }
    std::size_t end = begin;
    bool in_string = false;
    for (; end < plain.size() && (in_string || plain[end] != ';'); ++end) in_string ^= plain[end] == '\'';
    const std::size_t equals = plain.find('=', begin);
    std::size_t body = plain.find_first_not_of(" \t\r\n", equals + 1);
    std::string b;
    in_string = false;
    for (; body < end; ++body) {
      in_string ^= plain[body] == '\'';
      if (in_string || !std::isspace(static_cast<unsigned char>(plain[body]))) b += plain[body];
    }
    out.at[std::stoll(plain.substr(begin + 1))] = out.all.size();
    out.all.push_back({std::stoll(plain.substr(begin + 1)), b});
    k = end + 1;
  }
  return out;
}

inline std::string with_references(const std::string& body, const std::function<long long(long long)>& to) {
  std::string out;
  bool in_string = false;
  for (std::size_t k = 0; k < body.size();) {
    in_string ^= body[k] == '\'';
    if (!in_string && body[k] == '#') {
      std::size_t end = k + 1;
      while (end < body.size() && std::isdigit(static_cast<unsigned char>(body[end]))) ++end;
      out += "#" + std::to_string(to(std::stoll(body.substr(k + 1, end - k - 1)))), k = end;
    } else {
      out += body[k++];
    }
  }
  return out;
}

inline std::string keyword_of(const std::string& body) { return body.substr(0, body.find('(')); }

/// Top-level parameters of a simple instance.
inline std::vector<std::string> parameters_of(const std::string& body) {
  std::vector<std::string> out;
  int depth = 0;
  bool in_string = false;
  std::string now;
  for (std::size_t k = body.find('('); k < body.size(); ++k) {
    const char c = body[k];
    in_string ^= c == '\'';
    if (!in_string && c == '(' && depth++ == 0) continue;
    if (!in_string && c == ')' && --depth == 0) break;
    if (!in_string && c == ',' && depth == 1)
      out.push_back(now), now.clear();
    else
      now += c;
  }
  out.push_back(now);
  return out;
}
inline std::string instance_of(const std::string& keyword, const std::vector<std::string>& p) {
  std::string s = keyword + "(";
  for (std::size_t k = 0; k < p.size(); ++k) s += (k ? "," : "") + p[k];
  return s + ")";
}
inline long long id_in(const std::string& parameter) {
  return parameter.size() > 1 && parameter[0] == '#' ? std::stoll(parameter.substr(1)) : 0;
}
inline std::vector<std::string> items_of(const std::string& list) {
  return list == "()" ? std::vector<std::string>{} : parameters_of(list);
}

inline void renumber_and_shuffle(StepParts& s, std::uint64_t seed) {
  Random random(seed);
  std::vector<long long> fresh;
  for (std::size_t k = 0; k < s.all.size(); ++k) fresh.push_back(static_cast<long long>(k + 1) * 7 + 100);
  for (std::size_t k = fresh.size(); k > 1; --k) std::swap(fresh[k - 1], fresh[random.below(k)]);
  const auto to = [&](long long id) {
    const auto it = s.at.find(id);
    return it == s.at.end() ? id + 1'000'000'000 : fresh[it->second];
  };
  for (auto& i : s.all) i.body = with_references(i.body, to);
  for (std::size_t k = 0; k < s.all.size(); ++k) s.all[k].id = fresh[k];
  for (std::size_t k = s.all.size(); k > 1; --k) std::swap(s.all[k - 1], s.all[random.below(k)]);
  s.at.clear();
  for (std::size_t k = 0; k < s.all.size(); ++k) s.at[s.all[k].id] = k;
}

/// Comments, blanks, tabs and line ends between tokens.
inline std::string spread_out(const StepParts& s, const std::string& line_end) {
  const std::string between[] = {"", " ", line_end, "\t", "/* (#1,'; */", "  ", "", ""};
  Random random(5);
  std::string out = s.before;
  for (const auto& i : s.all) {
    out += "#" + std::to_string(i.id) + between[random.below(7)] + "=" + between[random.below(7)];
    bool in_string = false;
    for (char c : i.body) {
      const bool is_mark = c == ',' || c == '(' || c == ')';
      const bool was_string = in_string;
      in_string ^= c == '\'';
      if (!was_string && !in_string && is_mark) out += between[random.below(8)];
      out += c;
      if (!was_string && !in_string && is_mark) out += between[random.below(8)];
    }
    out += between[random.below(7)] + ";" + line_end;
  }
  return out + s.after;
}

/// Ten times the size: the unit every length goes back to is read as a ten times larger one.
inline bool scale_units(StepParts& s) {
  bool any = false;
  for (auto& i : s.all)
    for (const auto& [a, b] : {std::pair<std::string, std::string>{"SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.CENTI.,.METRE.)"},
                               {"SI_UNIT($,.METRE.)", "SI_UNIT(.DECA.,.METRE.)"}}) {
      const std::size_t at = i.body.find(a);
      if (at != std::string::npos) i.body.replace(at, a.size(), b), any = true;
    }
  return any;
}

/// Bounds without a word of which is the outer one, in the opposite order; loops that start elsewhere.
inline void reorder_bounds(StepParts& s) {
  for (auto& i : s.all) {
    const std::string k = keyword_of(i.body);
    if (k == "FACE_OUTER_BOUND") i.body = "FACE_BOUND" + i.body.substr(k.size());
    if (k == "ADVANCED_FACE" || k == "FACE_SURFACE" || k == "EDGE_LOOP") {
      auto p = parameters_of(i.body);
      auto list = items_of(p[1]);
      if (k == "EDGE_LOOP")
        std::rotate(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(list.size() / 2), list.end());
      else
        std::reverse(list.begin(), list.end());
      p[1] = instance_of("", list);
      i.body = instance_of(k, p);
    }
  }
}

/// Every edge the other way round: vertices swapped, sense turned, and every use of it turned.
inline void reverse_edges(StepParts& s) {
  const auto turned = [](const std::string& flag) { return flag == ".T." ? std::string(".F.") : std::string(".T."); };
  for (auto& i : s.all) {
    const std::string k = keyword_of(i.body);
    if (k != "EDGE_CURVE" && k != "ORIENTED_EDGE") continue;
    auto p = parameters_of(i.body);
    if (k == "EDGE_CURVE") std::swap(p[1], p[2]);
    p[4] = turned(p[4]);
    i.body = instance_of(k, p);
  }
}

/// Every bound written against its loop.
inline void reverse_bounds(StepParts& s) {
  std::map<std::string, int> uses;
  for (const auto& i : s.all) {
    const std::string k = keyword_of(i.body);
    if (k == "FACE_BOUND" || k == "FACE_OUTER_BOUND") ++uses[parameters_of(i.body)[1]];
    if (k == "EDGE_LOOP")
      for (const std::string& e : items_of(parameters_of(i.body)[1])) ++uses[e];
  }
  const std::size_t n = s.all.size();
  for (std::size_t b = 0; b < n; ++b) {
    const std::string k = keyword_of(s.all[b].body);
    if (k != "FACE_BOUND" && k != "FACE_OUTER_BOUND") continue;
    auto p = parameters_of(s.all[b].body);
    StepParts::Instance* loop = s.find(id_in(p[1]));
    if (!loop || keyword_of(loop->body) != "EDGE_LOOP" || uses[p[1]] != 1) continue;
    auto q = parameters_of(loop->body);
    auto list = items_of(q[1]);
    if (std::any_of(list.begin(), list.end(), [&](const std::string& e) {
          const auto* o = s.find(id_in(e));
          return uses[e] != 1 || !o || keyword_of(o->body) != "ORIENTED_EDGE";
        }))
      continue;
    std::reverse(list.begin(), list.end());
    for (const std::string& e : list) {
      auto* o = s.find(id_in(e));
      auto r = parameters_of(o->body);
      r[4] = r[4] == ".T." ? ".F." : ".T.";
      o->body = instance_of("ORIENTED_EDGE", r);
    }
    q[1] = instance_of("", list);
    loop->body = instance_of("EDGE_LOOP", q);
    p[2] = p[2] == ".T." ? ".F." : ".T.";
    s.all[b].body = instance_of(k, p);
  }
}

/// Curves of edges inside a surface curve, or outside the one they are in.
inline void wrap_curves(StepParts& s) {
  for (std::size_t k = 0, n = s.all.size(); k < n; ++k) {
    if (keyword_of(s.all[k].body) != "EDGE_CURVE") continue;
    auto p = parameters_of(s.all[k].body);
    const auto* c = s.find(id_in(p[3]));
    if (!c) continue;
    const std::string kind = keyword_of(c->body);
    if (kind == "SURFACE_CURVE" || kind == "SEAM_CURVE" || kind == "INTERSECTION_CURVE")
      p[3] = parameters_of(c->body)[1];
    else
      p[3] = "#" + std::to_string(s.add((k % 2 ? "SURFACE_CURVE(''," : "INTERSECTION_CURVE('',") + p[3] + ",(),.CURVE_3D.)"));
    s.all[k].body = instance_of("EDGE_CURVE", p);
  }
}

inline std::vector<double> reals_in(const std::string& list) {
  std::vector<double> v;
  for (const std::string& x : items_of(list)) v.push_back(std::strtod(x.c_str(), nullptr));
  return v;
}
inline std::string real_text(double v) {
  const std::string s = shortest_number(v);
  return s.find_first_of(".eE") == std::string::npos ? s + "." : s;
}
inline std::string reals_text(const Vec3& v) { return "(" + real_text(v.x()) + "," + real_text(v.y()) + "," + real_text(v.z()) + ")"; }

/// The whole model turned about its origin; placements that leave axes out get them, since what is left out would not turn.
inline void turn(StepParts& s, const Mat3& R) {
  std::map<long long, Vec3> direction;
  for (const auto& i : s.all)
    if (keyword_of(i.body) == "DIRECTION")
      if (const auto v = reals_in(parameters_of(i.body)[1]); v.size() == 3) direction[i.id] = Vec3(v[0], v[1], v[2]);
  const auto add_direction = [&](const Vec3& d) { return "#" + std::to_string(s.add("DIRECTION(''," + reals_text(R * d) + ")")); };
  for (std::size_t k = 0, n = s.all.size(); k < n; ++k) {
    const std::string word = keyword_of(s.all[k].body);
    if (word == "CARTESIAN_POINT" || word == "DIRECTION") {
      auto p = parameters_of(s.all[k].body);
      const auto v = reals_in(p[1]);
      if (v.size() == 3) p[1] = reals_text(R * Vec3(v[0], v[1], v[2])), s.all[k].body = instance_of(word, p);
    } else if (word == "AXIS2_PLACEMENT_3D" || word == "AXIS1_PLACEMENT") {
      auto p = parameters_of(s.all[k].body);
      Vec3 z = Vec3::UnitZ();
      if (const auto it = direction.find(id_in(p[2])); it != direction.end()) z = it->second.normalized();
      if (p[2] == "$") p[2] = add_direction(z);
      if (p.size() > 3 && p[3] == "$") p[3] = add_direction(std::abs(z.x()) > 1 - 1e-9 ? Vec3::UnitY() : Vec3::UnitX());
      s.all[k].body = instance_of(word, p);
    } else if (word == "COORDINATES_LIST") {
      auto p = parameters_of(s.all[k].body);
      std::string all = "(";
      for (const std::string& row : items_of(p[2])) {
        const auto v = reals_in(row);
        all += (all.size() > 1 ? "," : "") + reals_text(R * Vec3(v[0], v[1], v[2]));
      }
      p[2] = all + ")", s.all[k].body = instance_of(word, p);
    }
  }
}

struct Rewrite {
  std::string name;
  double scale = 1;
  std::function<std::string(const std::string&)> make;  // empty: the file does not lend itself
};

inline std::vector<Rewrite> rewrites() {
  const auto on_parts = [](void (*f)(StepParts&)) {
    return [f](const std::string& text) {
      StepParts s = parts_of(text);
      if (s.all.empty()) return std::string();
      f(s);
      return s.text();
    };
  };
  return {
      {"ids and order", 1, on_parts([](StepParts& s) { renumber_and_shuffle(s, 9); })},
      {"comments and blanks", 1, [](const std::string& t) { return spread_out(parts_of(t), "\n"); }},
      {"CRLF", 1, [](const std::string& t) { return spread_out(parts_of(t), "\r\n"); }},
      {"ten times larger unit", 10,
       [](const std::string& t) {
         StepParts s = parts_of(t);
         return scale_units(s) ? s.text() : std::string();
       }},
      {"bounds in another order", 1, on_parts(reorder_bounds)},
      {"edges the other way", 1, on_parts(reverse_edges)},
      {"bounds the other way", 1, on_parts(reverse_bounds)},
      {"curves wrapped or bare", 1, on_parts(wrap_curves)},
      {"turned", 1, on_parts([](StepParts& s) {
         turn(s, (Eigen::AngleAxisd(0.7, Vec3(1, -2, 0.5).normalized()) * Eigen::AngleAxisd(1.9, Vec3::UnitX())).toRotationMatrix());
       })},
      {"two data sections", 1,
       [](const std::string& t) {
         const StepParts s = parts_of(t);
         std::string out = s.before;
         for (std::size_t k = 0; k < s.all.size(); ++k) {
           if (k == s.all.size() / 2) out += "ENDSEC;\nDATA;\n";
           out += "#" + std::to_string(s.all[k].id) + "=" + s.all[k].body + ";";
         }
         return out + s.after;
       }},
  };
}

}  // namespace asbuilt::test
