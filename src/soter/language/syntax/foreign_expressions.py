"""Statements and expressions of other languages: the second table of `foreign_idioms.py`.

Purpose: what people bring from Python, C++, Rust, MATLAB, Lustre and textbooks where Soter has
something else, or nothing: lists, loops, tuples, slices, functions without a name, matrices.
Non-goals: declarations (`foreign_phrases.py`); items (`foreign_words.py`).
"""

from __future__ import annotations

import re

from soter.language.syntax.foreign_phrases import FUNCTION, NODE, PLANT, TOP, idiom
from soter.language.syntax.foreign_rewrites import (
    between,
    function_beside,
    function_of,
    loop_over,
    loop_to,
    matrix,
    member,
    of_any_type,
    one_by_one,
    one_of,
    part_of_a_list,
    positional,
    product,
    record_value,
    together,
    two_by_two,
    unpacked,
)

_STATEMENT = r"(?:^|(?<=[;{}]))[ \t]*"
_ARGUMENTS = r"(?:[^;()\n]|\((?:[^;()\n]|\([^;()\n]*\))*\))*"
_LIST = r"(?P<list>[A-Za-z_][\w.]*(?:\[\w+\])*)"
_CONDITION = r"\b(?P<word>safe|ttf|safer|always|never|assumes|guarantees|assert)\s+"
_BODIES = (NODE, FUNCTION)

EXPRESSIONS = (
    # calls
    idiom(
        r"\b(?P<at>(?:\w+::)*(?P<name>(?!\w+_cast\b)[a-z]\w*)\s*<\s*(?:int|float|double)\s*>)"
        r"(?=\s*\()",
        "a function finds its types by itself",
        of_any_type,
    ),
    idiom(
        r"\b(?:std::)?(?P<fun>min|max)\s*(?P<at>\(\s*\{(?P<values>[^{};\n]*)\}\s*\))",
        "`{0}` takes two values",
        two_by_two,
    ),
    idiom(
        r"(?P<at>\b(?:\w+\.)*(?:get_parameter|get_param|getParam)(?:<\w+>)?\s*\(\s*\""
        r"(?P<name>\w+)\"[^()\n]*\))(?:\s*\.\s*\w+(?:\(\s*\))?)*",
        "a parameter is read by its name",
        r"\g<name>",
        places=_BODIES,
    ),
    idiom(r"\b(?P<at>vec!)\s*(?=\[)", "a list is written without `{0}`", ""),
    idiom(r"(?P<at>~)(?=[A-Za-z_(])", "`{0}` is not an operator of Soter", "!"),
    idiom(r"(?P<at>\.([*/]))(?!\w)", "`{0}` is not an operator of Soter", r"\2"),
    idiom(
        r"(?<=[(,=])\s*(?P<at>&\s*(?:mut\s+)?)(?=[A-Za-z_])",
        "there are no references: a function gets a copy",
        "",
    ),
    idiom(
        r"(?P<at>\"\"\"(?P<what>[^\"\n]*)\"\"\")",
        "a comment is no text",
        r"/* \g<what> */",
    ),
    # lists
    idiom(
        _LIST + r"(?P<at>\.(?:append|push|push_back|emplace_back|add|insert|enqueue|put))\s*"
        rf"\((?P<what>{_ARGUMENTS})\)(?=\s*;)",
        "a value is put into a list by `push`",
        r"push \g<list>, \g<what>",
        places=_BODIES,
    ),
    idiom(
        r"\b(?P<at>push|append|push_back)\s*\(\s*" + _LIST + rf"\s*,\s*(?P<what>{_ARGUMENTS})\)"
        r"(?=\s*;)",
        "a value is put into a list by `push`",
        r"push \g<list>, \g<what>",
        places=_BODIES,
    ),
    idiom(
        _LIST + r"(?P<at>\.(?:clear|reset))\s*\(\s*\)(?=\s*;)",
        "a list is emptied by an assignment",
        r"\g<list> = []",
        places=_BODIES,
    ),
    idiom(
        _LIST + r"(?P<at>\.(?:pop|pop_front|pop_back|popleft|remove|erase|sort|reverse|extend))"
        rf"\s*\({_ARGUMENTS}\)",
        "a list only grows, by `push`",
        None,
        "build another list: `var rest: float[<=8];`, a loop over the old one, and `push rest, x;`",
        places=_BODIES,
    ),
    # calls that act
    idiom(
        _STATEMENT + r"(?P<at>(?:\w+(?:\.|::|->))*(?:sleep|usleep|msleep|sleep_for|sleep_until|"
        rf"delay|wait|wait_for|spin|spin_once)\s*\({_ARGUMENTS}\))(?=\s*;)",
        "a step does not wait: the period of its node says when the next one begins",
        None,
        "leave it out; to wait several steps, count them in a variable of the node: "
        "`var n: int in [0, 100];`",
        places=_BODIES,
    ),
    idiom(
        _STATEMENT + r"(?P<at>(?:\w+(?:\.|::|->))*(?:print|println!?|printf|log|"
        r"logf?(?:info|warn)|info!?|warn!?|debug!?|puts|display|disp|fprintf|"
        r"ROS_\w+|RCLCPP_\w+)\s*\(|std::c(?:out|err)\b)",
        "nothing is printed in a step: every topic is logged",
        None,
        "leave it out, or publish the value: `publish seen = x;`",
        places=_BODIES,
    ),
    # loops
    idiom(
        r"(?P<fun>\b[A-Za-z_]\w*)?\s*(?P<at>[\[(][^;={}:\n]*?\bfor\s+(?P<x>\w+)\s+in\s+"
        r"(?P<xs>[\w.]+)[^;\n]*?[\])])",
        "there are no comprehensions: a loop computes it",
        together,
        sure=False,
    ),
    idiom(
        r"\b(?:foreach|for\s+each|for)\s*(?P<at>\(\s*(?:const\s+)?(?:[\w:]+\s*&{0,2}\s+&{0,2})?"
        r"(?P<x>\w+)\s*(?::|in|of)\s*(?P<xs>[\w.]+)\s*\))",
        "a loop over elements has no brackets",
        loop_over,
    ),
    idiom(
        r"\b(?P<at>foreach|for\s+each)\s+(?P<x>\w+)\s+(?:in|of)\s+(?P<xs>[\w.]+)",
        "`{0}` is no word of Soter",
        loop_over,
    ),
    idiom(
        r"\bfor\s+(?P<x>\w+)\s+(?P<at>of)\s+(?P<xs>[\w.]+)",
        "a loop runs over what stands behind `in`",
        loop_over,
    ),
    idiom(
        r"\bfor\s*\(?\s*(?P<x>\w+)\s*(?P<at>(?:=|from|in)\s*(?P<low>\w+)\s*(?:to|through|:)\s*"
        r"(?P<high>\w+))(?:\s*\))?(?:\s*(?:do|loop|then)\b)?",
        "a loop counts over a range, whose end is left out",
        loop_to,
    ),
    idiom(
        r"\bif\s+(?P<c>[^;{}\n]+?)\s*(?P<at>\bthen\b)",
        "a block stands in braces",
        None,
        "write `if condition { ... } else { ... }`",
        places=_BODIES,
    ),
    # tuples
    idiom(
        r"\b(?P<word>let|var|auto|const)\s*(?P<at>[\[({]?\s*(?P<names>\w+(?:\s*,\s*\w+)+)\s*[\])}]?)"
        r"\s*=\s*(?P<what>[^;\n]+)(?=;)",
        "there are no tuples: each name is declared on its own",
        unpacked,
    ),
    idiom(
        _STATEMENT + r"(?P<word>)(?P<at>[\[(]?\s*(?P<names>[A-Za-z_]\w*(?:\s*,\s*[A-Za-z_]\w*)+)\s*"
        r"[\])]?)\s*=\s*(?P<what>[^;=\n][^;\n]*)(?=;)",
        "there are no tuples: each name is assigned on its own",
        unpacked,
        places=_BODIES,
    ),
    idiom(
        _STATEMENT + r"(?P<at>[A-Za-z_]\w*(?:\s*,\s*[A-Za-z_]\w*)+)\s*=(?!=)",
        "there are no tuples: each name is assigned on its own",
        None,
        "keep one value first: `let old = a;`",
        places=_BODIES,
    ),
    idiom(
        r"\b(?P<word>var|state|topic|let)\s+(?P<at>(?P<names>\w+(?:\s*,\s*\w+)+))\s*"
        r"(?P<rest>:[^;\n]*)(?=;)",
        "each name is declared on its own",
        one_by_one,
    ),
    idiom(
        r"\breturn\s+(?P<at>[^;(){}\[\]\n]+,[^;(){}\[\]\n]+)(?=;)",
        "a function returns one value",
        None,
        "return a record, `return { x: a, y: b };`, of a type that is declared",
        places=(FUNCTION,),
    ),
    # values
    idiom(
        r"\b(?P<name>\w+)\s*=\s*(?P<first>-?\d[\w.]*|true|false)\s*(?P<at>->)\s*(?P<what>[^;\n]+)",
        "there is no `->`: a variable has its first value where it is declared",
        lambda m: (
            f"write `{m['name']} = {m['what'].strip()};`, and `= {m['first']}` where "
            f"`{m['name']}` is declared"
        ),
        sure=False,
    ),
    idiom(
        r"(?P<xs>\b[A-Za-z_][\w.]*)\s*(?P<at>\[\s*(?P<low>[^\[\]:;?\n]*?)\s*:(?!:)\s*"
        r"(?P<high>[^\[\]:;?\n]*?)\s*(?::[^\[\]:;?\n]*)?\])",
        "there are no slices",
        part_of_a_list,
        sure=False,
        places=_BODIES,
    ),
    idiom(
        rf"\b(?P<name>[A-Z]\w*)\s*(?P<at>\((?P<fields>\s*\w+\s*=(?!=){_ARGUMENTS})\))",
        "a record is written with its fields, without its type",
        record_value,
    ),
    idiom(
        r"\b(?P<name>(?!(?:if|elseif|for|while|step|fun|on)\b)[a-z_]\w*)\s*"
        rf"(?P<at>\((?P<arguments>{_ARGUMENTS}?\b\w+\s*=(?!=){_ARGUMENTS})\))",
        "arguments have no names: they stand in the order of the parameters",
        positional,
    ),
    idiom(
        r"(?P<at>\[\s*(?P<rows>-?[\w.]+(?:[ \t]+-?[\w.]+|\s*[;,]\s*-?[\w.]+)+)\s*\])",
        "the elements of an array stand between commas",
        matrix,
    ),
    idiom(
        r"(?P<at>\[\s*-?\d[\w.]*(?:[ \t]+-?[\w.]+|\s*;\s*-?[\w.]+)+\s*\])\s*\*",
        "there are no matrices: nothing multiplies one",
        None,
        "write the components out: `a * p.x + b * p.y`",
    ),
    idiom(
        r"\bint\s*(?P<at>(?:\[|\(|<|range\b)\s*(?P<low>-?\w+)\s*(?:,|\.\.=?|:|to)\s*"
        r"(?P<high>-?\w+)\s*[\])>]?)",
        "the range of an int stands behind `in`",
        r"int in [\g<low>, \g<high>]",
    ),
    idiom(
        r"(?P<before>\b(?:topic|disturbance|state)\s+\w+\s*:\s*)float\s*"
        r"(?P<at>[\[(<]\s*(?P<low>[^\[\],;\n]+?)\s*(?:,|\.\.)\s*(?P<high>[^\[\],;\n]+?)\s*[\])>])",
        "the range stands behind `in`",
        r"\g<before>float in [\g<low>, \g<high>]",
    ),
    idiom(
        r"\bpublish\s+(?P<topic>\w+(?:\.\w+)?)(?P<at>\.(?P<field>\w+))\s*=\s*(?P<what>[^;\n]+)(?=;)",
        "a topic is published as a whole, with all its fields",
        r"publish \g<topic> = { \g<field>: \g<what>, ... };",
        sure=False,
    ),
    idiom(
        r"\bchoose\s*(?P<at>\[\s*(?P<values>[^\[\](){};,\n]+(?:,[^\[\](){};,\n]+){2,})\s*\])",
        "single values to choose from stand in braces; brackets are an interval",
        r"choose { \g<values> }",
    ),
    idiom(
        r"\bchoose\s*(?P<at>\(\s*(?P<values>[^\[\](){};,\n]+(?:,[^\[\](){};,\n]+)+)\s*\))",
        "values to choose from stand in braces",
        r"choose { \g<values> }",
    ),
    idiom(
        r"\bchoose\s+(?P<at>(?P<values>-?[\w.]+(?:\s*(?:,|\||\bor\b)\s*-?[\w.]+)+))(?=\s*;)",
        "values to choose from stand in braces",
        lambda m: f"choose {{ {', '.join(re.split(r',|[|]|or', m['values'].replace(' ', '')))} }}",
    ),
    idiom(
        r"(?P<at>\"(?P<member>[A-Za-z_]\w*)\")",
        "there are no texts at run time: the cases have names",
        member,
    ),
    idiom(
        _CONDITION + r"(?P<at>(?P<a>[^;\n=]+?)\s*(?:==?>|->|\|->|\bimplies\b)\s*(?P<b>[^;?\n]+))"
        r"(?=;)",
        "there is no sign for `implies`",
        r"\g<word> !(\g<a>) || \g<b>",
    ),
    idiom(
        _CONDITION + r"(?P<at>if\s+(?P<a>[^;\n]+?)\s+then\s+(?P<b>[^;?\n]+))(?=;)",
        "there is no sign for `implies`",
        r"\g<word> !(\g<a>) || \g<b>",
    ),
    idiom(
        r"(?P<x>\b[A-Za-z_][\w.]*)\s+(?P<at>in)\s*\[\s*(?P<low>[^\[\],;\n]+?)\s*,\s*"
        r"(?P<high>[^\[\],;\n]+?)\s*\](?=\s*(?:[;){?]|&&|\|\|))",
        "whether a value is in a range is asked by two comparisons",
        between,
    ),
    idiom(
        _STATEMENT + r"(?P<place>[A-Za-z_][\w.\[\]]*)\s*(?P<at><-)\s*(?P<what>[^;=\n]+)(?=;)",
        "assignment is `=`",
        r"\g<place> = \g<what>",
        places=_BODIES,
    ),
    idiom(
        _STATEMENT + r"(?P<at>(?P<sign>\+\+|--)\s*(?P<place>[A-Za-z_][\w.\[\]]*))(?=\s*;)",
        "`{1}` is not a statement of Soter",
        lambda m: f"{m['place']} = {m['place']} {m['sign'][0]} 1",
        places=_BODIES,
    ),
    # conditions
    idiom(
        r"(?P<x>\b[A-Za-z_][\w.]*)\s+(?P<at>(?:not\s+)?in)\s*[({\[]\s*(?P<values>[^(){}\[\];\n]+)\s*"
        r"[)}\]](?=\s*(?:[;){?]|&&|\|\||$))",
        "whether a value is one of several is asked one by one",
        one_of,
    ),
    idiom(
        r"(?P<x>\b[A-Za-z_][\w.]*)\s+(?P<at>(?:is\s+)?between)\s+(?P<low>[^\s;{}]+)\s+and\s+"
        r"(?P<high>[^\s;{}]+)",
        "whether a value is in a range is asked by two comparisons",
        r"\g<low> <= \g<x> && \g<x> <= \g<high>",
    ),
    idiom(r"(?P<at>~=|=/=)", "`{0}` is not an operator of Soter", "!="),
    idiom(r"(?P<at>=<)(?!=)", "`{0}` is not an operator of Soter", "<="),
    idiom(
        r"(?P<at>(?P<n>\d[\d.]*)\s*%)(?=\s*[;,)])",
        "there is no sign for `percent`",
        lambda m: f"{float(m['n']) / 100:.12g}",
    ),
    idiom(
        r"(?<![\w.])(?P<n>\d[\d.]*)(?P<at>[ \t]+)(?P<x>[A-Za-z_]\w*)(?=\s*[-+*/;),])",
        "a product is written with `*`",
        product,
        places=(*_BODIES, PLANT, TOP),
    ),
    idiom(
        r"(?P<at>\.(?:\*|/|\^)|<<|>>|\?\?|\?\.|<=>)",
        "`{0}` is not an operator of Soter",
        None,
        "the operators are `+ - * / %`, comparisons, `&& || !` and `condition ? a : b`",
    ),
    idiom(
        r"\b(?P<at>pre|prev|last|old)\s+(?P<x>[A-Za-z_]\w*)(?=\s*[-+*/;),<>])",
        "there is no operator for the value before",
        None,
        "keep it in a variable of the node, `var last: float = 0.0;`, that the end of the step "
        "assigns",
    ),
    idiom(
        r"\bassert\s*\(\s*(?P<c>[^;\n]+?)\s*(?P<at>[,:])\s*(?P<m>\"[^\"\n]*\")\s*\)(?=\s*;)",
        "`assert` is a statement: it has no brackets",
        r"assert \g<c>, \g<m>",
    ),
    idiom(
        r"\bassert\s+(?P<c>[^;\n]+?)\s*(?P<at>:|else|or)\s*(?P<m>\"[^\"\n]*\")(?=\s*;)",
        "the text of an `assert` stands behind `,`",
        r"assert \g<c>, \g<m>",
    ),
    idiom(
        r"(?P<at>\bnew\s+)?\b(?P<name>[A-Z]\w*)\s*(?P<fields>\{\s*\w+\s*:[^{};\n]*\})",
        "a record is written without its type",
        r"\g<fields>",
        places=_BODIES,
    ),
    idiom(
        rf"(?P<at>\b(?:new\s+)?[A-Z]\w*\s*\{{[^{{}}:;\n]*\}}|\bnew\s+\w+\s*\({_ARGUMENTS}\))",
        "a record is written with the names of its fields, without its type",
        None,
        "write `{ x: 1.0, y: 2.0 }`",
        places=_BODIES,
    ),
    idiom(
        r"(?P<what>\b[A-Za-z_][\w.]*)\s+(?P<at>as)\s+(?P<type>float|int)\b",
        "a conversion is a call",
        r"\g<type>(\g<what>)",
        places=_BODIES,
    ),
    idiom(
        r"(?<=[-=+*/(,] )(?P<at>(?P<type>float|int)\s+)(?P<what>[A-Za-z_][\w.]*)(?=\s*[-;+*/),])",
        "a conversion is a call",
        r"\g<type>(\g<what>)",
        places=_BODIES,
    ),
    idiom(
        r"(?P<at>\b[fFrRbu]\"[^\"\n]*\")",
        "there are no texts at run time",
        None,
        "name the cases, `type Name = enum { A, B };`, and write one of them: `Name.A`",
    ),
    # declarations that only look like statements
    *(
        idiom(
            _STATEMENT + r"(?P<at>(?P<name>[A-Za-z_]\w*)\s*:\s*(?P<type>(?:float|int|bool|duration)"
            r"(?:\[\w+\])?))(?=\s*[=;])",
            f"what is declared begins with `{word}`",
            rf"{word} \g<name>: \g<type>",
            places=places,
        )
        for word, places in (("var", _BODIES), ("state", (PLANT,)), ("const", (TOP,)))
    ),
    idiom(
        r"^(?P<at>(?:let\s+|const\s+|auto\s+|var\s+)?(?P<name>\w+)\s*=\s*(?:lambda\b\s*"
        r"(?P<a>[\w, ]*):|\|(?P<b>[\w, ]*)\||@?\(?(?P<c>[\w, ]*)\)?\s*=>|@\((?P<d>[\w, ]*)\)|"
        r"\[[&=]?\]\s*\((?P<e>[\w, ]*)\)\s*\{\s*return\b)\s*(?P<what>[^;\n]*))",
        "a function is declared by `fun`, with its types",
        function_of,
        sure=False,
        places=(TOP,),
    ),
    idiom(
        r"(?P<at>\b(?:const\s+)?(?:auto|let|var)\s+(?P<name>\w+)\s*=\s*\[[&=]?\]\s*"
        r"\((?P<e>[\w, ]*)\)\s*(?:->\s*\w+\s*)?\{\s*return\b\s*(?P<what>[^;{}\n]*);?\s*\})",
        "a function is declared by `fun`, with its types",
        function_beside,
        sure=False,
        places=_BODIES,
    ),
    idiom(
        r"(?P<at>\|\s*\w+\s*\||\(\s*\w*\s*\)\s*=>|\b\w+\s*=>|@\(\s*\w*\s*\)|\[[&=]?\]\s*\([^()]*\)"
        r"\s*\{)",
        "functions have names",
        None,
        "declare it beside the nodes: `fun name(x: float): float { return 2.0 * x; }`",
        places=_BODIES,
    ),
    idiom(
        r"^[ \t]*(?P<at>@\w+[\w.]*(?:\([^()\n]*\))?)",
        "there are no decorators: the first word of a declaration says what it is",
        "",
    ),
)
