// Loads of a skin from `suas invert SKIN --live PORT --serve HOST:PORT`, with the C++ library
// and POSIX sockets alone:
//
//     g++ -std=c++17 -O2 read_loads.cpp -o read_loads
//     SUAS_TOKEN=... ./read_loads 127.0.0.1 8701
//
// The server sends a line of JSON a frame. `value` picks a key's text out of an object without
// building a tree: a line of a few contacts takes some microseconds.

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

using Text = std::string_view;

// Where the value that begins at `i` ends: at a comma or bracket outside of it.
size_t end_of_value(Text json, size_t i) {
    int depth = 0;
    for (bool quoted = false; i < json.size(); ++i) {
        const char c = json[i];
        if (quoted && c == '\\') ++i;
        else if (c == '"') quoted = !quoted;
        else if (!quoted && (c == '{' || c == '[')) ++depth;
        else if (!quoted && depth == 0 && (c == ',' || c == '}' || c == ']')) break;
        else if (!quoted && (c == '}' || c == ']')) --depth;
    }
    return i;
}

// The values of an array, or the `"key": value` of an object.
std::vector<Text> items(Text json) {
    std::vector<Text> found;
    for (size_t i = 1; i + 1 < json.size();) {
        while (json[i] == ' ' || json[i] == ',') ++i;
        const size_t end = end_of_value(json, i);
        if (end > i) found.push_back(json.substr(i, end - i));
        i = end + 1;
    }
    return found;
}

// A key's value; empty where the object has no such key.
Text value(Text object, Text key) {
    for (Text item : items(object))
        if (item.size() > key.size() + 2 && item.substr(1, key.size() + 1) == std::string(key) + '"') {
            item.remove_prefix(item.find(':', key.size() + 2) + 1);
            while (!item.empty() && item[0] == ' ') item.remove_prefix(1);
            return item;
        }
    return {};
}

// A number; NaN for null and for a key that isn't there.
double number(Text json) {
    if (json.empty() || json[0] == 'n') return NAN;
    return std::strtod(std::string(json).c_str(), nullptr);
}

// The standard deviation of the k-th quantity (angle, [axial,] force, ...), SI units, radians.
double deviation(Text load, size_t k) {
    const std::vector<Text> rows = items(value(load, "covariance"));
    return k < rows.size() ? std::sqrt(number(items(rows[k]).at(k))) : NAN;
}

int connected(const char* host, const char* port) {
    addrinfo hints{}, *found = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(host, port, &hints, &found) != 0) throw std::runtime_error("no such host");
    const int s = socket(found->ai_family, found->ai_socktype, found->ai_protocol);
    const bool failed = s < 0 || connect(s, found->ai_addr, found->ai_addrlen) != 0;
    freeaddrinfo(found);
    if (failed) throw std::runtime_error("nobody listens there");
    return s;
}

void show(Text frame) {
    const std::string status(value(frame, "status"));
    std::printf("%.0f %s\n", number(value(frame, "seq")), status.c_str());
    for (Text load : items(value(frame, "loads"))) {
        const bool pad = !value(load, "axial_m").empty();
        std::printf("  %.2f +- %.2f N at %.2f deg", number(value(load, "force_N")),
                    deviation(load, pad ? 2 : 1), number(value(load, "angle_deg")));
        std::printf(pad ? ", %.2f mm\n" : "\n", 1e3 * number(value(load, "axial_m")));
    }
    std::fflush(stdout);
}

int main(int count, char** words) try {
    const char* token = std::getenv("SUAS_TOKEN");
    if (count != 3 || !token) throw std::runtime_error("usage: SUAS_TOKEN=... read_loads HOST PORT");
    const int s = connected(words[1], words[2]);
    const std::string first = std::string(token) + "\n";
    if (send(s, first.data(), first.size(), 0) < 0) throw std::runtime_error("the line is dead");
    std::string waiting;
    char bytes[65536];
    for (ssize_t got; (got = recv(s, bytes, sizeof bytes, 0)) > 0;) {
        waiting.append(bytes, static_cast<size_t>(got));
        for (size_t end; (end = waiting.find('\n')) != std::string::npos; waiting.erase(0, end + 1))
            show(Text(waiting).substr(0, end));
    }
    close(s);
} catch (const std::exception& problem) {
    std::fprintf(stderr, "read_loads: %s\n", problem.what());
    return 2;
}
