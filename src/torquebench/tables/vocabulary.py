"""Meanings of the words in a column's name, in six languages and in technical terms.

The languages are English, German, Chinese, French, Spanish and Japanese. A name is understood if
all its words are known: "Reference torque (N·m)", "Bezugsdrehmoment", "标准扭矩值", "couple de
référence". With a single unknown word, the whole name isn't understood, because a wrong guess would
go unnoticed.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import cache

_WORDS: Mapping[str, str] = {
    "reading": """
        reading readings read indicated indication indicator measured measurement measure meas uut
        dut iut sensor transducer loadcell display displayed observed signal
        anzeige anzeigen messwert istwert ist mess prüfling pruefling prüf pruef aufnehmer gemessen
        gemessene gemessenes angezeigt angezeigte angezeigtes ablesung ablesewert
        信号 示值 读数 测量 实测 被测 被检 显示 指示 测得 传感器
        lecture lu lue lus mesure mesuré mesurée indiqué indiquée affiché affichage capteur
        señal lectura indicación indicado indicada medido medida medición leído leída sensor
        transductor
        信号 指示 測定 実測 読み 読取 読取り 表示 計測""",
    "standard": """
        reference ref standard applied true calibrator master certified deadweight
        referenz normal normals bezug bezugs bezugsnormal aufgebracht aufgebrachtes angelegt
        angelegtes eingeleitet eingeleitetes wahr wahres
        标准 参考 标准器 基准 施加 真值 真实
        référence étalon appliqué appliquée vrai vraie
        referencia patrón aplicado aplicada verdadero estándar
        基準 標準 標準器 参照 印加 真値""",
    "nominal": """
        nominal target setpoint set demand demanded command commanded desired requested
        soll sollwert nenn nennwert vorgabe stufe laststufe zielwert nominell
        标称 名义 设定 目标 指令 给定
        nominale consigne cible visé palier
        objetivo consigna escalón
        公称 目標 設定 指令""",
    "torque": """
        torque moment trq torsion
        drehmoment md
        扭矩 转矩 力矩 扭力
        couple
        momento par torsor
        トルク""",
    "force": "force load kraft last 力 载荷 负荷 force charge fuerza carga 荷重 力 荷重値",
    "mass": "mass weight masse gewicht 质量 砝码 masse poids masa peso 質量 分銅",
    "angle": """
        angle encoder twist ang rotation
        winkel drehwinkel verdrehung verdrehwinkel
        角度 转角 角位移 扭转角
        ángulo
        回転角 ねじれ角""",
    "speed": """
        speed velocity vel rotational
        drehzahl winkelgeschwindigkeit geschwindigkeit
        转速 速度
        vitesse
        velocidad
        回転数 回転速度""",
    "acceleration": """
        acceleration winkelbeschleunigung beschleunigung 角加速度 加速度 accélération aceleración
        """,
    "temperature": "temperature temp temperatur 温度 température temperatura",
    "time": "time elapsed timestamp zeit zeitstempel 时间 temps tiempo 時間 時刻",
    "position": """
        position pos mounting stellung einbaulage einbaustellung 位置 安装 montage posición 取付位置
        """,
    "series": "series reihe messreihe serie 序列 系列 série シリーズ",
    "branch": "branch ast 分支 rama branche",
    "direction": "direction richtung drehrichtung 方向 sens dirección sentido 回転方向",
    "input": "input motor eingang antrieb antriebs 输入 电机 entrée moteur entrada 入力",
    "output": "output ausgang abtrieb abtriebs 输出 sortie salida 出力",
    "zero": "zero null nullpunkt zeroing 零点 zéro cero ゼロ",
    "uncertainty": """
        uncertainty unsicherheit messunsicherheit 不确定度 incertitude incertidumbre 不確かさ""",
    "error": "error deviation abweichung fehler 误差 示值误差 erreur écart desviación 誤差 器差",
    "loop": "loop cycle schleife zyklus 循环 boucle ciclo サイクル",
    "repeat": "repeat repetition wiederholung 重复 répétition repetición 繰返し",
    "run": "run lauf 次数 essai ensayo 試行",
    "": """
        value values wert werte 值 valeur valeurs valor valores 値
        mean average avg mittel mittelwert mittlere mittleres 平均 moyen moyenne media
        medio promedio
        expanded erweiterte 扩展 élargie expandida 拡張
        of the at under test device unit instrument item actual act
        der des die das am im unter
        de la le du l el del en d
        的 の cell torsor angular rotary shaft welle""",
}
"""Words by their meaning; those without a meaning may occur in any name."""
_PHRASES: Mapping[str, str] = {
    "load direction": "branch",
    "loading direction": "branch",
    "direction of loading": "branch",
    "belastungsrichtung": "branch",
    "up": "branch",
    "auf": "branch",
    "auf/ab": "branch",
    "up/down": "branch",
    "行程": "branch",
    "加载方向": "branch",
    "sens de charge": "branch",
    "sentido de carga": "branch",
    "負荷方向": "branch",
    "load cell": "reading",
    "dead weight": "standard",
    "set point": "nominal",
    "set-point": "nominal",
    "par": "torque",
    "u": "uncertainty",
    "device under test": "reading",
    "unit under test": "reading",
    "reading of the standard": "standard",
    "standard reading": "standard",
}
_CONTENT: Mapping[str, tuple[frozenset[str], frozenset[str], frozenset[str]]] = {
    quantity: (frozenset(must.split()), frozenset(may.split()), frozenset(loose.split()))
    for quantity, must, may, loose in (
        # quantity; words that its name must have; may have; and may have if no name fits better
        ("reading", "reading", "torque", ""),
        ("standard", "standard", "torque reading force mass", ""),
        ("nominal", "nominal", "torque force", ""),
        ("torque", "torque", "reading", "output input"),
        ("angle", "angle", "reading position", "output"),
        ("speed", "speed", "reading angle", "input"),
        ("acceleration", "acceleration", "reading", ""),
        ("temperature", "temperature", "reading", ""),
        ("zero_temperature", "temperature zero", "", ""),
        ("standard_temperature", "temperature standard", "", ""),
        ("time", "time", "reading", ""),
        ("position", "position", "angle", ""),
        ("series", "series", "reading", ""),
        ("branch", "branch", "", ""),
        ("direction", "direction", "torque", ""),
        ("input_torque", "torque input", "reading", ""),
        ("output_torque", "torque output", "reading", ""),
        ("input", "input", "angle position reading", ""),
        ("output", "output", "angle position reading", ""),
        ("expanded_uncertainty", "uncertainty", "torque reading error angle", ""),
        ("error", "error", "torque reading angle", ""),
        ("loop", "loop", "", ""),
        ("repeat", "repeat", "", ""),
        ("run", "run", "", ""),
    )
}


def _plain(text: str) -> str:
    """Return a text without case, accents and connections between words.

    >>> _plain("Référence_Couple"), _plain("AppliedTorque")
    ('reference couple', 'applied torque')
    """
    text = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", text)
    decomposed = unicodedata.normalize("NFKD", text)
    folded = "".join(mark for mark in decomposed if not "\u0300" <= mark <= "\u036f").casefold()
    return " ".join(re.sub(r"[\s_.,:;/-]+", " ", unicodedata.normalize("NFKC", folded)).split())


@cache
def _vocabulary() -> tuple[dict[str, str], dict[str, str]]:
    words = {_plain(word): content for content, words in _WORDS.items() for word in words.split()}
    return words, {_plain(phrase): content for phrase, content in _PHRASES.items()}


@cache
def meanings(stem: str) -> frozenset[str] | None:
    """Return the meanings of the words in a name; None if a word is unknown, or none has a meaning.

    Examples
    --------
    >>> sorted(meanings("Reference torque")), sorted(meanings("Bezugsdrehmoment"))
    (['standard', 'torque'], ['standard', 'torque'])
    >>> sorted(meanings("标准扭矩值")), meanings("Kanal 3")
    (['standard', 'torque'], None)
    """
    words, phrases = _vocabulary()
    plain = _plain(stem)
    if plain in phrases:
        return frozenset((phrases[plain],))
    found: set[str] = set()
    for phrase in sorted((each for each in phrases if " " in each), key=len, reverse=True):
        if f" {phrase} " in f" {plain} ":
            found.add(phrases[phrase])
            plain = f" {plain} ".replace(f" {phrase} ", " ").strip()
    tokens = plain.split()
    if tokens[:1] == ["std"]:  # after other words it means a standard deviation
        found.add("standard")
        tokens = tokens[1:]
    for token in tokens:
        parts = (token,) if token in words else _parts(token)
        if parts is None:
            return None
        found.update(words[part] for part in parts)
    return frozenset(found - {""}) or None


@cache
def _parts(token: str) -> tuple[str, ...] | None:
    """Return the words in a compound such as Referenzmoment or 标准扭矩值."""
    words, _ = _vocabulary()
    if token in words:
        return (token,)
    chinese = ord(token[0]) > 0x2E7F
    for length in range(len(token) - 1, 0 if chinese else 2, -1):
        head, tail = token[:length], token[length:]
        if head not in words:
            continue
        for rest in (tail, tail.removeprefix("s")):
            parts = _parts(rest) if rest and (chinese or len(rest) > 2) else None
            if parts is not None:
                return (head, *parts)
    return None


def matches(found: frozenset[str], quantity: str, kind: str) -> int:
    """Return how well a name's meanings fit a quantity: 2 well, 1 loosely, 0 not at all.

    Examples
    --------
    >>> matches(frozenset({"torque", "output"}), "torque", "torque")
    1
    >>> matches(frozenset({"nominal", "speed"}), "demanded", "speed")
    2
    """
    if quantity == "demanded":
        return 2 * (frozenset({"nominal"}) <= found <= frozenset({"nominal", kind}))
    must, may, loose = _CONTENT.get(quantity, (frozenset((quantity,)), frozenset(), frozenset()))
    if not must <= found:
        return 0
    if found <= must | may:
        return 2
    return int(found <= must | may | loose)
