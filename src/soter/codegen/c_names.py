"""Chooses names for C things.

Purpose: keeps the names of the source, but makes them legal and unique, and different from every
name with a meaning to C, to its headers or to the generated code itself.
Non-goals: which things have names.

Three name spaces: temporaries (`local`), members of structs (`field_name`), and the file
(`FileNames`, whose names all begin with the program's prefix).
"""

from __future__ import annotations

import re

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while _Bool _Complex _Imaginary asm typeof alignas alignof constexpr nullptr static_assert
thread_local typeof_unqual noreturn complex imaginary
bool true false NULL NAN INFINITY EOF NDEBUG DECIMAL_DIG BUFSIZ L_tmpnam P_tmpdir
errno stdin stdout stderr math_errhandling setjmp va_arg va_copy va_end va_start
F_OK R_OK W_OK X_OK STDIN_FILENO STDOUT_FILENO STDERR_FILENO WEOF
assert offsetof isnan isinf signbit isfinite isnormal fpclassify linux unix i386 mips sparc
"""
_CPP = """
and and_eq bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield compl
concept const_cast consteval constinit decltype delete dynamic_cast explicit export friend mutable
namespace new noexcept not not_eq operator or or_eq private protected public reinterpret_cast
requires static_cast template this throw try typeid typename using virtual xor xor_eq
"""
_TYPES = """
size_t ptrdiff_t wchar_t max_align_t float_t double_t intptr_t uintptr_t intmax_t uintmax_t
"""
_SIZED = [f"{u}int{kind}{n}_t" for u in ("", "u") for kind in ("", "_fast", "_least")
          for n in (8, 16, 32, 64)]  # fmt: skip
_OWN = """
s state flags published answer fault status first began got kept made message outer release sent
sqrt floor fabs
"""
_FIRMWARE = """
self value measured now stamp stored layout size seed late outside ages
"""
_MACRO = re.compile(
    r"(U?INT|SIZE_|PTRDIFF_|WCHAR_|WINT_|FP_|HUGE_VAL|MATH_|M_|DBL_|FLT_|LDBL_|SOTER"
    r"|FE_|[SU]?CHAR_|U?SHRT_|U?L?LONG_|MB_|CLOCKS_|EXIT_|RAND_|SEEK_|TMP_|FOPEN_|FILENAME_"
    r"|E[A-Z0-9]|SIG_?[A-Z]|(PRI|SCN)[a-zX])"
    r"[A-Z0-9_]*"
)
"""Macros of limits, errors (E...), signals (SIG...) and formats: families reserved by C."""
_RESERVED = re.compile(r"(m_)*_[_A-Z].*")
"""Names like `_Atomic` and `__LINE__`, which are reserved for compilers."""
_HIDDEN = re.compile(r"fair_\d+")
_FUNCTIONS = """
FILE DIR va_list jmp_buf sigjmp_buf
abort abs access accept alarm atof atoi atol bind bsearch calloc clearerr clock close
connect creat ctime difftime div div_t dup exit fclose feof ferror fflush fgetc fgets fileno fopen
fork fprintf fputc fputs fread free freopen fscanf fseek ftell fwrite getc getchar getenv gets
gmtime imaxabs index kill labs ldiv ldiv_t link listen lldiv_t localtime longjmp main malloc memchr
memcmp memcpy memmove memset mktime open pause perror pipe poll printf putc putchar puts qsort raise
rand read realloc recv remove rename rewind rindex scanf select send shutdown signal sigaction sleep
snprintf socket sprintf srand sscanf stat strcat strchr strcmp strcpy strlen strncmp strtod strtol
symlink sync syslog system time tmpfile tolower toupper truncate umask ungetc unlink usleep vprintf
wait write y0 y1 yn j0 j1 jn gamma environ optarg optind
"""
_MATH = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim
floor fma fmax fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2 logb
lrint lround modf nan nearbyint nextafter nexttoward pow remainder remquo rint round scalbln scalbn
sin sinh sqrt tan tanh tgamma trunc
"""
_STRING = """
memchr memcmp memcpy memmove memset strcat strchr strcmp strcoll strcpy strcspn strerror strlen
strncat strncmp strncpy strpbrk strrchr strspn strstr strtok strxfrm
"""
_NO_FUNCTION = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while _Bool _Complex _Imaginary asm typeof bool true false NULL NAN INFINITY offsetof
isnan isinf signbit isfinite isnormal fpclassify
"""
_HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math memory setjmp signal
stdalign stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string strings tgmath
threads time uchar unistd wchar wctype features endian values program
"""

WORDS = frozenset((*_WORDS.split(), *_CPP.split()))
"""Words of C and C++, macros of the headers that generated files include and of compilers."""
TYPES = frozenset((*_TYPES.split(), *_SIZED))
"""Types of those headers."""
GENERATED = frozenset(_OWN.split())
"""Names that generated functions use themselves."""
HEADERS = frozenset(_HEADERS.split())
"""Names of headers: the header of a program with such a name would hide the other."""
AT_FILE_LEVEL = HEADERS.union(
    _FUNCTIONS.split(),
    (name + kind for name in _MATH.split() for kind in ("", "f", "l")),
    _FIRMWARE.split(),
)
"""Names that the C library and POSIX declare, and parameters that would hide a name of the file."""


def why_not_linkable(name: str, *, node: bool) -> str:
    """Why generated code cannot call a user's C function of this name; "" if it can.

    `node`: the function is bound to an extern node, so its signature is not that in `math.h`.
    """
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is None:
        return "no function of C can be called so"
    if name in _NO_FUNCTION.split() or name in TYPES:
        return "it is a word of C or of its headers"
    if re.match(r"soter_|SOTER_|U?INT\d*_", name):
        return "names that begin so are those of the run-time and of its headers"
    math = (m + kind for m in _MATH.split() for kind in ("", "f", "l"))
    if name in _STRING.split() or (node and name in math):
        return "it is a function of the C library, which generated code calls"
    return ""


def legal_name(text: str) -> str:
    """A C identifier made from any text."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text.replace("]", ""))  # `r[0].x` is r_0_x
    if not name or name[0].isdigit():
        name = "n" + name
    return name


def has_meaning(name: str) -> bool:
    """Whether C or one of its headers already gives this name a meaning."""
    return name in WORDS or name in TYPES or _MACRO.fullmatch(name) is not None


def program_prefix(stem: str) -> str:
    """The prefix of all C names of a program, made from the name of its source file.

    It is not the name of a C header, and does not begin with `soter`, which is the run-time's.
    """
    prefix = legal_name(stem)
    if prefix in HEADERS or prefix.lower().startswith("soter"):
        return "my_" + prefix
    return prefix


def file_level_name(text: str) -> str:
    """A name for file level without the program's prefix, such as the name of a struct.

    It has no meaning in C or C++ of any standard, in their libraries or in POSIX.
    """
    name = legal_name(text)
    taken = has_meaning(name) or name in AT_FILE_LEVEL or name.endswith("_t")
    if taken or name.startswith("_") or "__" in name or name.lower().startswith("soter"):
        return "my_" + re.sub("__+", "_", name.strip("_"))
    return name


def local_name(text: str, prefix: str) -> str:
    """The C name of a temporary of Core; different temporaries have different names."""
    name = legal_name(text)
    taken = ("v_", "soter_", "out_", "has_", "drawn_", "given_", "_", prefix + "_")
    if has_meaning(name) or name in GENERATED or name.startswith(taken):
        return "v_" + name
    return name


def field_name(text: str) -> str:
    """The C name of a struct member; different names stay different, and none is `pad_`.

    A hidden local's name has a space, which becomes `_`; a name in the program that looks like the
    result gets one more `_`.
    """
    name = legal_name(text)
    if _RESERVED.fullmatch(name):
        return "m_" + name
    stem = name.rstrip("_")
    looks_hidden = " " not in text and _HIDDEN.fullmatch(stem) is not None
    if has_meaning(stem) or (stem == "pad" and name != "pad") or looks_hidden:
        return name + "_"
    return name


class UniqueNames:
    """Hands out the names of one name space, and each name only once."""

    def __init__(self, taken: frozenset[str] = frozenset()) -> None:
        self._taken = set(taken)

    def __call__(self, text: str) -> str:
        """A legal name, made from `text`, that was not handed out before."""
        base = field_name(text)
        name, n = base, 2
        while name in self._taken:
            name = f"{base}_{n}"
            n += 1
        self._taken.add(name)
        return name


class FileNames:
    """Hands out names of file level, `prefix_name`, each name only once."""

    def __init__(self, prefix: str, taken: tuple[str, ...]) -> None:
        self.prefix = prefix
        self._taken = {f"{prefix}_{name}" for name in taken}

    def __call__(self, text: str) -> str:
        """A new name made from `text`; it begins with the prefix, once."""
        return self.new_family(text, ())

    def new_family(self, text: str, endings: tuple[str, ...]) -> str:
        """A new name that stays new if any of these endings is added to it."""
        base = legal_name(text)
        if not base.startswith(self.prefix + "_"):
            base = f"{self.prefix}_{base}"
        name, n = base, 2
        while self._is_used(name, endings):
            name = f"{base}_{n}"
            n += 1
        self._taken.update(name + ending for ending in ("", *endings))
        return name

    def _is_used(self, name: str, endings: tuple[str, ...]) -> bool:
        names = {name + ending for ending in ("", *endings)}
        return bool(names & self._taken) or any(has_meaning(n) for n in names)
